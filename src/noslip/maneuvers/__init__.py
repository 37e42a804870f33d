"""Maneuvers: motions in closed form that lead a tool from one pose to another."""
