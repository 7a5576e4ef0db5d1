"""Every number that decides something in the gap search: unit, meaning, and what it rests on."""

#: Speed below which friction is not known well enough to be judged: the width that the Coulomb sign has by default
#: [rad/s, m/s]. Recordings of three arms disagree below it from one reversal to the next.
SLOW_RAD, SLOW_M = 0.01, 1e-3
#: Share of its joint's Coulomb friction by which a reversal may be sharper or rounder within ``SLOW_RAD``, one standard
#: deviation: a step instead of a ramp is 1, and half of that is usual. At 2 it swallows a Stribeck hump of 0.03 rad/s.
SHARPER = 0.7
#: Spread of the logarithm of that share: an effect with the sign of the velocity is as sharp as friction is.
SHARPER_SPREAD = 0.8
#: The same of a reversal twice as wide as ``SLOW_RAD``. Free, as it was, it swallowed Stribeck humps up to 0.1 rad/s.
WIDER = 0.15
#: Friction that may act in a row, or may not, in units of the noise, from which the row does not count. evidence:
#: benchmarks/gap_choices.md: what was left of joints that stopped for a moment had 4 to 34 times the power of the noise
#: with these rows, and 0.9 to 2.1 times without.
UNKNOWN_FRICTION = 5.0
#: Power of white noise that the stop band of the filter leaves of both sides, as a share of the noise. Without it an
#: autoregressive model whitens by 1e4 where there is no signal, and differences of the two sides look like effects.
STOP_BAND = 0.05
#: Error of the acceleration torques of one joint by each joint's acceleration, a share; three times as much above 2 Hz.
ACCELERATION = 0.03
#: Error of all accelerations alike above 1 and above 4 Hz, a share: what position filters and late encoders leave.
#: Without it a false elasticity had log odds of 211, with it 5.7.
DROOP = 0.3
#: Widths of the means that accelerations above 4 and 1 Hz are what is left of [s].
DROOP_WIDTHS_S = (0.03, 0.1)
#: Skew of a recorder between positions and torques, one standard deviation in sampling periods: recorders of public
#: arms skew by up to 0.3. Without it delays of 1.3 ms were named.
SKEW_PERIODS = 0.15
#: Usual rms of one kind of what is left, in units of the noise, and the spread of its logarithm.
REST_USUAL, REST_SPREAD = 0.05, 1.5
#: Rms from which a kind of what is left is something that is missing, and not what every log has a little of; its price
#: is that of a name.
REST_ACTIVE, REST_EDGE = 0.1, 0.4
#: Rows that the measured noise of a band counts as.
BAND_ROWS = 4.0
#: Prior sizes of an effect's torque in units of the noise; each is as likely.
SCALES = (1.0, 10.0, 100.0)
#: Share of a column's power that is never alike another column: rounding of products. unit: 1.
ALIKE = 1e-6
#: Posterior probability of a name against every other name.
AGAINST_OTHERS = 0.95
#: Log odds of changes beside others: loads are put on every day; a rotor does not get heavier, and a stop stays where
#: it is.
CHANGES = {
    "payload": 3.0,
    "end_stop": -7.0,
    "motor_inertia": -7.0,
    "joint_elasticity": -7.0,
    "backlash": -7.0,
    "gear_friction": -7.0,
    "presliding_hysteresis": -7.0,
}
#: Log odds of the first look from which a candidate is looked at with the rest sized beside it, and how many are at
#: each of two sizes of the rest: of 24 names and rivals, all were among the first four of one of them.
WORTH_A_LOOK, MOST_LOOKS = 2.0, 4
#: Visible size in units of the noise from which an effect is of any account, and a rest is.
MATERIAL, MATERIAL_REST = 0.3, 0.5
#: Log odds of a rest that is told.
REST_SURE = 5.0
#: Share of its evidence that a rival keeps when the effect is in place: what keeps more explains something else.
INSTEAD = 0.5
#: Posterior probability from which a candidate below ``SURE`` is told as likely.
LIKELY = 0.5
#: Log odds against a counterbalance on an axis: one of twenty has one. evidence: none, a round number.
COUNTERBALANCE_RARE = 3.0
#: Spread of the logarithm of an arm's mass for its reach, and the heaviest [kg/m^2]. evidence: data sheets: Kinova Gen2
#: 3, UR10e 16, iiwa 14 19, TX40 45, KR 210 75.
MASS_SPREAD, HEAVIEST = 1.1, 75.0
#: A link, or a torque offset, is odd that would be so many times as large without a counterbalance.
#: evidence: benchmarks/gap_stranger.md, seeds 103 and 104: none of the 24 clean arms is odd.
ODD_TIMES = 2.0
#: How much louder than measured the noise is, in power, from which something is missing that no kind of the rest holds:
#: clean logs reach 1.06, ringing after reversals 2.5; without repeats it is louder than in its quietest band, by up to
#: 2.8 in 58 of 60 clean logs.
LOUDER, LOUDER_UNSURE = 1.25, 3.0
#: Length of a block [s], and power of the loudest over the usual one, from which it is a disturbance that does not
#: repeat: sharp reversals reach 15 in clean logs, a push of a quarter of a second thousands.
STRAY_BLOCK_S, STRAY_POWER = 0.5, 40.0
#: Highest over median power of the noise's spectrum in the pass band from which something rings: clean logs reach
#: 2.1, a link that rings 22.
RINGS = 6.0
#: Shapes within which an effect is judged, speeds for a width of ``SLOW_RAD``: a narrower hump cannot be told from how
#: friction turns, a wider one not from viscous friction. Narrower ones were named in 3 of 14 clean cases.
RANGES = {
    ("stribeck", "vs"): (0.018, 0.25),
    ("stribeck", "d"): (0.6, 2.5),
    ("presliding_hysteresis", "delta"): (0.002, 0.3),
    ("nonlinear_viscous", "p"): (0.3, 3.2),
}
