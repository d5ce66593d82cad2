"""A parametric human: body, masses, authored motions with exact ground truth, markers, degradation."""
