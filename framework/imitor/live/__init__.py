"""Live capture: datagrams to samples to human frames, and the other way round for rehearsal.

| module | idea |
|---|---|
| `sample` | what a protocol's decoder gives: one whole instant of the sender |
| `mailbox` | newest sample wins; nothing queues up |
| `receiver` | one thread reads a socket, counts what is wrong, keeps the newest |
| `source` | the base of live sources |
| `sender` | what `imitor stream` needs of a protocol |
"""
