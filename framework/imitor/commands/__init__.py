"""Commands on their way to a robot: what sinks that move one share, and what their protocols say.

| module | idea |
|---|---|
| `command` | what a robot is told at one instant |
| `approach` | slowly from where the robot is to what it is told |
| `pace` | one command a period, where nothing else keeps time |
| `robot_sink` | the base of robot sinks: unarmed or armed, start, hiccups, end |
| `joints` | joint names on both sides |
| `g1` | joint orders of the Unitree G1 |
| `udp_json`, `sonic`, `twist2` | message formats |
| `unitree_hg` | DDS types and checksum of Unitree's humanoids |
"""
