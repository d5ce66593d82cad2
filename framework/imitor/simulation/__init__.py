"""Physics: a robot of position-driven joints stands on a floor and executes a motion. Heavy; import it late."""
