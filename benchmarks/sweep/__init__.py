"""Random jobs, and a judge that recomputes from files alone what was said of each.

``python -m benchmarks.sweep --jobs 2000`` (or ``make sweep``): random recordings, rules, limits,
goals and noise go through ``noslip learn``, ``adapt`` and ``rollout``.  The judge knows nothing of
noslip: it reads the CSV files with NumPy, has a formula of its own for every rule, and holds each
sentence that the program said, and each that it did not say, against what it finds.
"""
