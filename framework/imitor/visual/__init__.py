"""How a run looks: surfaces of robots, the human's stick figure, the scene and its camera. Shared by viewers."""
