"""Moments become parameters with bounds.

Nothing here knows a robot's file or Pinocchio, except the estimators that need each sensor's noise.
Start with `frischid.estimators.least_squares`.
"""
