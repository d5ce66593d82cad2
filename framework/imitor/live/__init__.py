"""Live capture: datagrams to samples to human frames, and the other way round for rehearsal.

| module | idea |
|---|---|
| `sample` | what a protocol's decoder gives: one whole instant of the sender |
| `mailbox` | newest sample wins; nothing queues up |
| `receiver` | one thread reads a socket, counts what is wrong, keeps the newest |
| `source` | the base of live sources |
| `sender` | what `imitor stream` needs of a protocol |
| `stream` | which datagram leaves when, and a sender that keeps the time |
| `parts` | puts together what a sender had to cut |
| `points`, `markers`, `targets` | the person that joint positions, markers or targets show, learned once |
| `art` | the ASCII lines of ART DTrack |
| `segment_body`, `bone_body`, `forward` | from the poses of a sender's segments to human frames |
| `xsens_wire`, `xsens_null_pose`, `xsens_body`, `xsens_sender` | network streaming of Xsens MVN |
| `osc`, `vmc`, `vmc_body` | the VMC protocol |
| `natnet`, `natnet_frame`, `natnet_model`, `natnet_decoder`, `natnet_body`, `natnet_sender` | OptiTrack's NatNet |
| `asker` | asks a sender from the socket that listens |
"""
