"""Loop 3: from stacked rows to parameters with honest error bars that belong to a physical arm.

fullnumericregressor.npz -> parameters.npz. All functions work on plain arrays; the small triangular factors of
``least_squares.accumulate`` stand for any number of samples.
"""
