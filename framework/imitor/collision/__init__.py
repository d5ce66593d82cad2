"""Distances between the links of a robot, and the smallest motion that keeps them apart."""
