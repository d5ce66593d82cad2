"""Safety: what every command passes before it leaves the framework."""
