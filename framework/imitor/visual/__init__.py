"""How a run looks: surfaces of robots, the human's stick figure, scene and camera. Shared by viewers."""
