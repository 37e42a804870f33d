"""Recordings in the formats where they live: ROS bags, data sets, tables; read and written.

One module a format; :mod:`noslip.recordings.formats` lists them, and chooses among them by what a
path is.
"""

from noslip.recordings.bag_writing import write_bag
from noslip.recordings.bags import BagTopic, bag_topics
from noslip.recordings.columns import read_column
from noslip.recordings.formats import (
    load_demonstrations,
    load_trajectory,
    write_joints,
    write_recording,
)

__all__ = [
    "BagTopic",
    "bag_topics",
    "load_demonstrations",
    "load_trajectory",
    "read_column",
    "write_bag",
    "write_joints",
    "write_recording",
]
