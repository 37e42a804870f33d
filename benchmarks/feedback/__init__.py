"""Generators of references in a loop: what becomes of a motion on a robot that is not ideal.

A *scenario* draws robots, sensors, clocks and disturbances from the ranges that it is about; a
*generator* commands a pose each cycle from what it is told; the *judge* measures what was commanded
and executed, against bounds.  ``python -m benchmarks.feedback`` prints the table.
"""
