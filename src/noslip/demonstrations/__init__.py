"""Recordings in files -> PoseTrajectory, and preparing them."""
