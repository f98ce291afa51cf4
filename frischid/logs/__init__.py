"""Files of measurements become logs, and logs become filtered motions.

Comes in: CSV, Parquet, NPZ or ROS bags. A file is read as a table, a mapping says what its columns mean, a `Log`
holds the samples. Goes out: motions, with positions, velocities and accelerations that nothing delayed.
Start with `frischid.logs.log`, then `frischid.logs.preprocessing`, which uses `time_grid`, `derivatives`, `filters` and
`standstill`.
"""
