"""Random damage to files that strangers may send: what reads them must refuse it, or use it.

    python -m benchmarks.fuzz primitive --executions 1000000

Counts what must never happen: an exception that is none of noslip's, more than a second of
processor time, more than a gigabyte of memory, and numbers that are not finite.
"""
