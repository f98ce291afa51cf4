"""Logs become a model, and a model is held against logs.

`identification` runs the whole pipeline, `model` is what it gives and saves, `comparison` measures its error.
Start with `frischid.model.identification`.
"""
