"""From checked logs to parameters with robust error bars that belong to a possible arm (Paper Eqs. 23 and 24).

The way of a torque sample: ``conditioned_log`` filters it, ``observation_rows`` puts the regressor beside it, ``stack``
folds the rows into triangular factors, ``estimators`` fit them, ``covariance`` says how certain that is,
``physical_parameters`` finds the nearest possible arm, ``estimate`` decides what is in force, and ``result`` keeps it.
"""
