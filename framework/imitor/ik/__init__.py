"""Numeric kernels of inverse kinematics: task rows, the prioritised step, the clamping loop.

Used by solvers, mappers and post-processors; plain functions and small classes on arrays.
"""
