"""Many recordings -> a primitive each, in one process, in several, or on a cluster.

What is sent to a worker is a path and a text (JSON): constraints as their expressions, never as
pickled code.  A worker reads the recording and writes the primitive, so that both must lie where it
can reach them under the same path; figures of merit come back.  CasADi graphs are built once a
worker.
"""

from noslip.many.executors import cluster
from noslip.many.learning import LearnedEach, learn_each
from noslip.many.recordings import find_recordings

__all__ = ["LearnedEach", "cluster", "find_recordings", "learn_each"]
