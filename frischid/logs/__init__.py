"""From files of measurements to logs, and from logs to filtered motions.

Comes in: CSV, Parquet, NPZ or ROS bags. A file is read as a table, a mapping gives the meaning of its columns, a `Log`
holds the samples. Goes out: motions, with positions, velocities and accelerations that no filter has delayed.
Start with `frischid.logs.log`, then `frischid.logs.preprocessing`, which uses `time_grid`, `derivatives`, `filters` and
`standstill`.
"""
