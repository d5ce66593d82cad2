"""Contact of the hands with objects: grips, limits, where the robot stands to reach them."""
