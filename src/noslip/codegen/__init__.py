"""C99 of a primitive's step: as text for a robot, as machine code for this process."""
