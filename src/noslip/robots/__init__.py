"""Arms: motions tracked without slip, placements, closed-loop dynamics.  Extra ``robots``."""
