"""The numbers of this folder that decide something: unit, meaning, evidence."""

import numpy as np

# ---------------------------------------------------------------- rows
#: A log with fewer rows than so many seconds have is not split into fitted and held-out ones. evidence: none yet.
SHORTEST_SPLIT_S = 1.5
#: Samples evaluated at once. evidence: none yet.
ROWS_EVALUATED = 4096

# ---------------------------------------------------------------- stacks
#: Fits until columns that scale with the model have settled; each changes them by the effect's share of the torque.
#: evidence: none yet.
SCALED_ROUNDS = 3

# ---------------------------------------------------------------- delay of the torques
#: A delay is corrected when it is this many standard errors from zero. Real arms without a known delay reach 2.7 and
#: their logs disagree about its sign, those with one 4.3 to 11.8. evidence: those figures.
DELAY_CLEAR_ERRORS = 3.0
#: Up to this a delay is corrected without a warning [s]: within the half sample that a controller holds its torque.
#: evidence: none yet.
DELAY_SAID_S = 2e-3
#: A delay, or its change once it is corrected, counts as zero below this [s]; it is estimated at most so many times.
#: evidence: none yet.
DELAY_SETTLED_S, DELAY_ROUNDS = 2e-4, 3

# ---------------------------------------------------------------- least squares
#: Rows factored at once: larger blocks leave the cache. evidence: none yet.
ROWS_FACTORED = 512
#: Singular value of the column-normalised matrix, relative to the largest, below which a direction is not excited.
#: evidence: none yet.
RANK_TOLERANCE = 1e-8
#: Rows that a joint must have beyond the parameters that they were spent on, before they say how noisy it is.
#: evidence: none yet.
LEAST_ROWS_LEFT = 1.0
#: Rounds after which noise and weights are taken as they are. evidence: none yet.
FIT_ROUNDS = 50
#: Rows count so many times less compared with the prior, which short logs depend on; error bars do not include it.
#: evidence: benchmarks/choices.md.
HELD_BACK = 2.0
#: A log of 20 rows per second is worth about one independent row per second, and never less than one in so many.
#: evidence: none yet.
LARGEST_INFLATION = 60.0

# ---------------------------------------------------------------- covariance
#: Two degrees of freedom have no variance; nothing is said about fewer. evidence: law of Student's t.
LEAST_FREEDOM = 2.5
#: Relative standard error up to which a parameter is known well, and up to which roughly. evidence: a convention.
WELL_ERROR, ROUGH_ERROR = 0.10, 0.30
#: Change of torque, in standard deviations of a single sample, that nobody would notice. evidence: none yet.
HARMLESS_TORQUE = 0.05

# ---------------------------------------------------------------- spikes
#: Residual, in robust standard deviations, from which on its weight falls; 95 % efficient without spikes (Huber 1981).
#: evidence: that law.
HUBER = 1.345
#: Rms change of a round, in standard errors of independent combinations of parameters, from which on weights have
#: settled. evidence: none yet.
HUBER_SETTLED = 1e-3
#: Kurtosis of a joint's residuals from which on the robust fit is used. Coloured but spike-free residuals of arms reach
#: 5; one percent of spikes gives 20 and more. evidence: those figures.
SPIKE_KURTOSIS = 8.0
#: Rows of a joint below which their middle is no noise: a joint that hardly moves has as many as it has parameters.
#: evidence: none yet.
NOISE_LEAST_ROWS = 20

# ---------------------------------------------------------------- instruments
#: Condition number of the column-normalised Z^T S W beyond which the instruments say nothing. evidence: none yet.
INSTRUMENTS_WORST_CONDITION = 1e12

# ---------------------------------------------------------------- prior of the bodies
#: s above: the tails' slope is gamma (1 / s - 1). evidence: none yet.
PRIOR_FOLLOWED = 0.5
#: Share of the mean link's mass that a default cylinder gives for a ball of the mean link's extent: a cylinder as short
#: as a small DH offset is no link. evidence: 0.1 and 0.3 predict all pairs of real recordings alike (4.23 %); with 0.1,
#: 0.2 and 0.3 88, 90 and 92 % of the inertial parameters of an arm with a link of 35 mm and 5 kg lie inside their
#: intervals, the worst 5.8, 3.2 and 3.3 standard errors off; with 0.3 joints whose torques are wrong spoil others.
BALL_SHARE = 0.2
#: Share of the prior's curvature that error bars count: true links differ from default cylinders by more than the prior
#: says. Chosen on simulated arms with links of random lumps; docs/explanation/estimators.md has the coverage.
#: evidence: those figures.
PRIOR_COUNTED = 0.5

# ---------------------------------------------------------------- interior point
#: Steps after which the method gives up; arms of seven links take 10 to 30, noise-free rows 100. evidence: none yet.
INTERIOR_STEPS = 150
#: Excess of the objective over its minimum at which the method stops. evidence: none yet.
INTERIOR_TOLERANCE = 1e-9
#: Share of the way to the boundary that one step may go. evidence: none yet.
INTERIOR_REACH = 0.9

# ---------------------------------------------------------------- physically possible parameters
#: Weight of the divergence from the prior, in units of 1/2 chi-square. Within a few percent of the best in every regime
#: of docs/explanation/estimators.md, where cross-validation costs 0.5 s and was worse.
#: evidence: those figures.
PRIOR_WEIGHT = 3.0
#: Weight of the logarithm of a bound that only has to hold: too small to bias anything. evidence: none yet.
BOUND_WEIGHT = 1e-5
#: Rounds of pooling, relative change of the sizes at which it ends, and excess at which each round is solved.
#: evidence: none yet.
POOLING_ROUNDS, POOLING_SETTLED, POOLING_TOLERANCE = 100, 0.03, 1e-3
#: Change of the logarithm of the common size of the prior's bodies at which it is found. evidence: none yet.
SIZE_SETTLED = 0.02
#: A parameter comes from the data when these take away at least this share of what the prior left open.
#: evidence: none yet.
FROM_DATA_SHARE = 0.5

# ---------------------------------------------------------------- residual model: columns
#: Highest harmonics of the position, alone and times the Coulomb sign. evidence: none yet.
POSITION_HARMONICS, FRICTION_HARMONICS = 3, 2
#: Speeds, as shares of the rms speed of the fitted motion, at which shapes of the friction have fallen to 1/e.
#: evidence: none yet.
FRICTION_SPEEDS = (0.1, 0.4, 1.6)
#: Residual, in robust standard deviations, as which larger ones count. Huber's limit would take away what the columns
#: are there to explain. evidence: none yet.
RESIDUAL_FAR = 5.0

# ---------------------------------------------------------------- residual model: sizes and evidence
#: Largest size of each group, lambda: variance of a column's torque over that of the noise. A short slow log would
#: otherwise let the columns explain everything that it has. evidence: none yet.
RESIDUAL_LARGEST = np.array([3.0, 10.0, 100.0]) / 26.0
#: Size that counts as nothing. evidence: none yet.
RESIDUAL_NOTHING = 1e-7
#: Sizes from which the search begins. Why two: shapes of friction and friction by load take each other's place, and
#: from equal sizes the search finds the former alone where the latter explains more. evidence: none yet.
RESIDUAL_BEGIN = ((0.05, 0.05, 0.05), (0.001, 0.001, 1.0))
#: Gain of the log evidence from which on there is model error: three sizes were chosen.
#: evidence: none yet.
RESIDUAL_EVIDENCE = 4.0
#: States of an exciting motion: torques are judged on them, and columns made orthogonal to the parameters.
#: evidence: none yet.
RANDOM_STATES = 1500
#: Rms speed of an exciting motion, as a share of the velocity limits, and the limit of a joint without one: turning
#: [rad/s], sliding [m/s]. evidence: none yet.
EXCITING_SPEED, FREE_SPEED = 0.2, (2.5, 0.5)
#: Positions of a joint without limits: turning [rad], sliding [m]. evidence: none yet.
FREE_TRAVEL = (-np.pi, np.pi), (-0.3, 0.3)

# ---------------------------------------------------------------- joints whose torques contradict those of the others
#: Sizes of what a joint's own parameters may differ by, that are tried: lambda, in variances of the prior.
#: evidence: joints with something wrong took 1e-3 to 1e2.
APART_SIZES = 10.0 ** np.arange(-4.0, 3.1)
#: Gain of the log evidence that makes a joint one apart, and by which another size of one that is apart is better.
#: evidence: joints of real arms with nothing wrong reach 13.4 (LWR4+), 14.7 (UR10) and 14.9 (Rokae), of simulated ones
#: 1.5; a scaled, reversed or partial torque 16.5 to 2e5, and the wrists of the Shanghai cobot 27 to 1700.
APART_EVIDENCE, APART_SETTLED = 15.0, 0.1
#: By how much rows may narrow the prior's variances: beyond, torques have no noise, and what contradicts is rounding.
#: evidence: none yet; logs of simulated arms with noise reach 1.3e9, of real ones 1e6.
APART_TOLD = 1e11
#: Rounds of sizes, joints apart and the arm that the others show; the last changes nothing as a rule.
#: evidence: none yet.
APART_ROUNDS = 4

# ---------------------------------------------------------------- posterior
#: Parts that recordings are cut into, which have to agree.
#: evidence: halves of the Rokae's recording, two to eight: four tell best how far both are apart.
PARTS_OF_LOG = 4
#: By how much offsets and levels of friction differ between the quarters of a recording, as shares of the friction:
#: sizes that are tried, and how many. evidence: none yet.
CHANGE_SIZES, CHANGE_GRID = (1e-4, 0.2), 25
#: Scale and degrees of freedom of that share's half-t prior: recordings of which nothing is known differ by 10 %.
#: evidence: simulated arms that get warm; with four degrees and 0.003, 86 % of their parameters are inside.
CHANGE_PRIOR, CHANGE_FREEDOM = 0.005, 2.0
#: How many times further recordings are apart than the quarters of one. evidence: simulated arms at another
#: temperature, seeds 1 to 12 and 13 to 22: with 8 intervals hold 90 and 93 % of the true values, with 10 92 and 95 %,
#: with 12 94 and 96 %.
CHANGE_BETWEEN = 10.0
#: A parameter counts as told by the rows when they leave this share of the prior's variance. evidence: a convention.
TOLD_SHARE = 0.1
#: Where something is missing in the model, the columns hold a part of it; by this factor the residual of another
#: recording is larger than that of the fitted one (recordings of real arms and simulated ones, median).
#: evidence: those figures.
UNSEEN_RESIDUAL = 1.2
#: Gain of the log evidence from which on a joint has a torque of its position that no possible arm has, and joints
#: that may have one. evidence: none yet.
LARGE_TORQUE_EVIDENCE, LARGE_TORQUE_JOINTS = 10.0, 3

#: Least torque that a joint is thought to need before anything is measured, as a share of the largest of any joint.
#: evidence: none yet.
LEAST_TORQUE = 0.05

# ---------------------------------------------------------------- estimate
#: A parameter that differs from its prior by less than this share has not moved. evidence: none yet.
PRIOR_UNCHANGED = 1e-9
#: Samples of each fitted motion that a result keeps, so that a repetition of it is recognised: two minutes.
#: evidence: none yet.
MOTION_SAMPLES = 600

# ---------------------------------------------------------------- findings
#: Torque error on an exciting motion that what a log leaves open costs, from which on it counts as poorly excited [%].
#: A condition number would hang on the choice of base columns. evidence: none yet.
POORLY_EXCITED_PERCENT = 50.0
#: A physical set that explains the torques worse than the plain fit by more than this factor contradicts the data.
#: evidence: none yet.
CONTRADICTION = 1.5
#: Share of open parameters beyond which a log is called poor. evidence: none yet.
MANY_OPEN = 0.2
#: Poses in which the mass matrix is tested. evidence: none yet.
ALARM_POSES = 500
#: Parameters that are named with the reason; the rest are counted. evidence: a convention.
FINDINGS_WORDED = 3

# ---------------------------------------------------------------- comparison of results
#: Chance of naming any parameter when none has changed.
#: evidence: tests/unit/estimation/test_result.py counts its false alarms.
CHANGE_FALSE_ALARM = 0.01
#: A parameter's change is measured against its value, or against this many standard errors where that is more:
#: a parameter that is known to 10 % or better is measured against itself. evidence: none yet.
CHANGE_FLOOR_ERRORS = 10.0

# ---------------------------------------------------------------- payload
#: Radius of the ball that stands for a load's shape before measuring, such as a hand's or a tool's [m].
#: evidence: none yet.
LOAD_RADIUS_M = 0.08
#: Mass of that ball when the data say nothing or less than nothing [kg]. evidence: none yet.
LOAD_LEAST_KG = 0.05
#: Share of the variance of the torque's scale that all joints have in common: one data sheet, one ageing.
#: evidence: none yet.
COMMON_SCALE_SHARE = 0.75
#: How far each joint's gain may be off by itself, as a share: sizes that the evidence of a loaded log weighs.
#: evidence: none yet.
OWN_SCALE_ERRORS = (0.0, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32)
#: By how much the torque scale of a real arm's joint differs between two recordings, as a share: its sensors and drives
#: get warm. Chosen on recordings of the LWR4+, in which a scale 0.5 % wrong at the shoulder weighs 50 g at the flange.
#: evidence: those figures.
SCALE_DRIFT = 0.005
#: Least change of a joint's friction that is thought possible, as a share of the largest torque of any joint.
#: evidence: none yet.
FRICTION_CHANGE_LEAST = 0.01
#: Misfit over its expectation from which on something else than a load has changed. evidence: none yet.
LOAD_MISFIT = 4.0

# ---------------------------------------------------------------- gains of drives
#: Gauss-Newton ends when no gain changes by more than this share, at the latest after so many steps.
#: evidence: none yet.
GAINS_SETTLED, GAINS_ROUNDS = 1e-6, 60
#: A joint's gain changes by at most this factor in a step; the problem is bilinear and a first guess may be poor.
#: evidence: none yet.
GAINS_LONGEST_STEP = np.log(3.0)

# ---------------------------------------------------------------- the noise floor
#: Seconds of each log that the noise is taken from: minutes say what hours do.
NOISE_SECONDS = 240.0
#: Shortest repeat of a motion that counts [s]: long enough that different motions do not agree by chance.
SHORTEST_REPEAT_S = 4.0
#: Largest distance of two runs of one motion, as a share of its spread. evidence: repeats of real and simulated arms
#: differ by 0.003 to 0.006, other motions by about 1.
REPEATED = 0.03
#: A joint that moves less says nothing about which motion it is [rad or m]. evidence: none yet.
STILL_RAD = 1e-3
#: Fewest rows that have a spectrum. evidence: none yet.
SPECTRUM_ROWS = 64
#: Band that the level of the noise is taken from, as shares of the cut-off: above the motion, below the stop band.
#: evidence: benchmarks/judgement.md, white noise of simulated arms is found within 10 %.
NOISE_BAND = (0.55, 1.0)

# ---------------------------------------------------------------- draws
#: Steps of the walk of a draw. evidence: of the shipped log of an LWR4+ the spread of parameters is 0.58 of that of the
#: normal posterior after 20 steps, 0.76 after 200 and 0.78 after 600, for what is cut off; 0.5 s for 100 draws.
DRAW_WALK = 200
#: Angles that are tried on an ellipse before a draw stays where it is. evidence: each halves what is left, on average.
DRAW_TRIES = 12
#: Directions that together change bodies by less than this, as a sum of squares of relative changes, are drawn freely.
#: evidence: without it bands of torque hold one measured value of a hundred less.
DRAW_FREE = 0.1
