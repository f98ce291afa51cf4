"""Where a model fails, which physical effect is missing, and how far the error falls with the effect.

Comes in: a model and logs. Goes out: findings with evidence, a verdict, and better models.
Start with `frischid.diagnosis.diagnosis`.
"""
