"""Robots: the card (data), the model (the one place that touches Pinocchio), and what is said about them."""
