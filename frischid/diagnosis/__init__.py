"""Where a model fails, which physical effect is missing, and what happens when the effect is added.

Start with `frischid.diagnosis.diagnosis`: its module text lists the stages in order.
"""
