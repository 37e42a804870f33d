"""Recordings in the formats where they live: ROS bags, data sets, tables; read and written.

One module a format; each reader returns :class:`~noslip.trajectory.PoseTrajectory`.
:func:`noslip.load_demonstrations` chooses among them by what a path holds.
"""

from noslip.recordings.bags import BagTopic, bag_topics
from noslip.recordings.writing import write_bag, write_joints, write_recording

__all__ = ["BagTopic", "bag_topics", "write_bag", "write_joints", "write_recording"]
