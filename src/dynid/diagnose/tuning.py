"""What decides in this folder: thresholds, counts and shares, each with its unit and what it rests on."""

import numpy as np

#: Share of a joint's torque that the plain fit may leave before ``identify`` asks whether the robot file is wrong.
#: Evidence: benchmarks/mapping.md, When does identify ask: half and double miss nothing.
UNEXPLAINED = 0.05

#: Where gravity seems to be removed, another mapping has to explain this many times more to be the likelier mistake.
#: Evidence: none yet.
GAIN_OVER_GRAVITY = 4.0
#: What each edit has to lower the mean logarithm of the joints' residuals by. Evidence: benchmarks/mapping.md: what
#: is hidden and what is named.
CLEAR = 0.1
#: A robot file that leaves more of the torques beyond friction explains none. Evidence: right edits leave 0.02 to 0.3.
HARDLY_EXPLAINED = 0.5
#: Free numbers of a joint: a short log explains itself with many robot files. Evidence: none yet.
FREE_NUMBERS = 10.0
#: Hypotheses that are taken further with a second edit, and a third; and where no first one helps. Evidence: none
#: yet.
BEAM, BEAM_LOST = 4, 16
#: They are when they are not so much worse than the best. Evidence: none yet.
NEAR_BEST = 0.4
#: A joint whose torque leaves this many times more when its friction has to brake, with either sign of the torque, is
#: explained by no robot file. Evidence: J5 and J6 of the Shanghai cobot 1.7 to 3.6, its J4 1.3 to 2.6; all joints of
#: nine right recordings of six other arms at most 1.04.
NOT_BRAKING = 1.25
#: Sensors and models are wrong by this share of what the most loaded joint carries, at every joint. Evidence: none
#: yet.
MODEL_ERROR = 0.01
#: A robot file of which less is explained (mean logarithm) may have two mistakes that hide each other. Evidence: none
#: yet.
WELL_EXPLAINED = -0.7
#: How much less likely a mistake is, in units of ``CLEAR``, where several explain the log equally well. Evidence:
#: none yet.
UNLIKELY = {
    "convention": 0.0,
    "sign": 0.0,
    "unit": 0.0,
    "torques": 0.02,
    "order": 0.04,
    "gravity": 0.04,
    "offset": 0.06,
    "positions": 0.08,
    "signs": 0.08,
    "torque": 0.08,
    "position": 0.1,
}
#: The same for each column beyond two that another order moves, and for an order that recorders and people make.
#: Evidence: none yet.
COLUMN_MOVED, REGULAR_ORDER = 0.3, 0.3
#: The same for each joint that moves far beyond its limits, of which so many count; the limits may be wrong as well.
#: Evidence: none yet.
OUT_OF_RANGE, MOST_OUTSIDE = 0.5, 2
#: Hypotheses whose ranks differ by less explain a log equally well. Evidence: none yet.
TIED = 0.02
#: So do those whose residuals agree to this share: boxes around links differ a little. Evidence: none yet.
SAME_RESIDUAL = 0.05
#: So many of them are told. Evidence: none yet.
MOST_TIED = 3

#: Samples that robot files are fitted to. Evidence: none yet.
SAMPLES = 250
#: Longest time that positions are smoothed over before they are differentiated [s]; 1.65 periods of the
#: cut-off that an estimation would choose. Evidence: none yet.
SMOOTHING_S = 0.15
#: Samples from the middle of a long log. Evidence: none yet.
MIDDLE_SAMPLES = 60_000
#: Usual sizes of the ten parameters of a link [kg, kg m, kg m^2]: much larger values come from fitting noise.
#: Evidence: none yet.
USUAL_BODY = np.array([5.0, 1.0, 1.0, 1.0, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3])
#: Samples that follow each other say the same: so many count as one. Evidence: none yet.
SAMPLES_ALIKE = 10.0
#: Torques are never modelled better than to this share of what a joint's change at all. Evidence: none yet.
MODELLED = 0.01
#: Point masses along each side of a link's box, and how far it reaches beyond the joints: [m], and as a share.
#: Evidence: none yet.
BOX_POINTS, BOX_MARGIN_M, BOX_MARGIN_SHARE = 4, 0.1, 0.25

#: A joint takes part when its expected torque changes by this share of the largest change. Evidence: none yet.
SIGNIFICANT_LOAD = 0.3
#: Expected changes below this [N m] drown in friction. Evidence: none yet.
LEAST_LOAD_NM = 1.0
#: A counterbalance may carry all that the heaviest joint would; where masses are known, lighter joints of heavy arms
#: then tell: those whose expected torque changes by this share of the largest change, and by so much [N m]. Evidence:
#: none yet.
LIGHTER_JOINT, LIGHTER_LOAD_NM = 0.05, 10.0
#: Measured change over expected one: rough masses are right within a factor of three; with unknown masses of ten.
WEIGHT_SHARE_KNOWN = 0.1
WEIGHT_SHARE_UNKNOWN = 0.03
#: So many times these shares is the least that a weight shows: a third, and a tenth; two standard errors have to lie
#: between. Evidence: 300 simulated logs of an LWR4+ of 3 s that moves by 0.04 rad: 3 refused without this (shares of
#: 0.05 to 0.09 with errors of 0.26 to 1.1), none with it; of 400 logs without gravity 128 are told instead of 140.
LEAST_WEIGHT = 10.0 / 3.0
#: Likeness of torque and weight over poses, 0 to 1, from which the torque has another scale instead of no weight.
#: Evidence: 1.00 for the KUKA LWR4+'s recording and six simulated ones at a fiftieth of their size; without gravity
#: 0.01 to 0.24, with 5 % of it left 0.85 to 0.91.
ALIKE = 0.95
#: A load whose change is, but for this share, also that of friction or inertia shows nothing. Evidence: none yet.
DISTINCT_LOAD = 0.2
