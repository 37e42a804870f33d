"""C99 of a primitive's step and of a plan: text for a robot, machine code for this process."""
