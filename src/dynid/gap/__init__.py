"""Loop 4: find where model and measurement disagree, name the missing effect, add it, show that the gap shrinks.

parameters.npz + logs -> verdict, a copy of the robot file with the effect, before and after on unseen data.
"""
