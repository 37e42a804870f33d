"""Primitives in a control loop."""
