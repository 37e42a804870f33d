"""How constraints are made to hold: at each step, and over a whole trajectory."""
