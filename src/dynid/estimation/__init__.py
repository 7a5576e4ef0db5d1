"""From checked logs to parameters with robust error bars that belong to a possible arm (Paper Eqs. 23 and 24).

The way of a torque sample: ``conditioned_log`` filters it, ``rows`` puts the regressor beside it, ``stack`` has
the rows of all logs, ``estimators`` fit them, ``covariance`` says how certain that is, ``posterior`` finds the nearest
possible arm, ``estimate`` decides what is in force, ``identified`` keeps it, and ``result`` is what notebooks have.
"""
