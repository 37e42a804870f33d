"""From recordings to demonstrations: preparing, cutting, aligning, leaving out."""
