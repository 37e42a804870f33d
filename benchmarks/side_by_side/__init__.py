"""Other libraries at the same job, one module a kind; ``python -m benchmarks.side_by_side``.

The job is the paper's numerical example: a blade that must not slip sideways, led along a path
whose demonstration slips 3.5 m/s, first to the demonstrated end, then to one 0.2 m aside.
"""
