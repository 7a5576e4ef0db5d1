"""From checked logs to parameters with robust error bars that belong to a possible arm (Paper Eqs. 23 and 24).

The way of a torque sample: ``conditioned_log`` filters it, ``rows`` puts the regressor beside it, ``stack`` has
the rows of all logs, ``estimators`` fit them, ``covariance`` says how certain that is, ``prior`` what was known before,
``residual_model`` what parameters leave, ``posterior`` finds the nearest possible arm with both, ``estimate`` decides
what is in force, ``findings`` says what that is worth, ``identified`` keeps it, and ``result`` is what notebooks have.
"""
