"""Logs become a model, and a model is held against logs.

Comes in: a robot and logs. Goes out: a `Model` that is saved as one JSON file, and its error on other logs.
Start with `frischid.model.identification`.
"""
