"""From logs to a model, and from a model to its error on logs.

Comes in: a robot and logs. Goes out: a `Model` that is saved as one JSON file, and its error on other logs.
Start with `frischid.model.identification`.
"""
