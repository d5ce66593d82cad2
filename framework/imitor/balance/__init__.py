"""What stabilizers share: the CoM's offset along the line of the feet, and the change of support."""
