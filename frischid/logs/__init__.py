"""Files of measurements become logs, and logs become filtered motions.

A file is read as a table (`tables`, `bags`), a mapping says what its columns mean (`mapping`), a `Log` holds the samples,
and `preprocessing` gives positions, velocities and accelerations without delay. Start with `frischid.logs.log`.
"""
