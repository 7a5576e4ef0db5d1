"""The numbers of this folder that decide something: unit, meaning, evidence.

Margins that keep a motion safe are not tuned on benchmarks: their evidence is a rating, a law, or the check after them.
"""

import math

# ---------------------------------------------------------------- limits that a robot file leaves out
#: Range of a revolute joint without position limits [rad]: it turns for ever, and no plan asks more than two turns each
#: way. evidence: none yet.
ENDLESS_RANGE_RAD = (-4 * math.pi, 4 * math.pi)
#: Range of a prismatic joint without position limits [m], which no slide is without. evidence: none; it is not played.
SLIDE_RANGE_M = (-0.1, 0.1)
#: Stand-ins for rates [rad/s or m/s, and per second]. evidence: none; a plan says that it took them, and is not played.
DEFAULT_VELOCITY, DEFAULT_ACCELERATION = 1.0, 3.0

# ---------------------------------------------------------------- families of motions
#: No two knots are nearer [s]. evidence: its fifth power divides, 1e-30.
NEAREST_KNOTS_S = 1e-6
#: Rounds of the rule that lengthens intervals between waypoints; each brings every interval to within a few percent,
#: and the rest is lengthened by one factor. evidence: none yet.
STRETCH_ROUNDS = 60

# ---------------------------------------------------------------- limits of a motion
#: Rate of the check at full speed; a slowed motion is checked at the same points of its path [Hz].
#: evidence: the rate at which controllers of arms interpolate (FRI of the LWR4+: 1 kHz).
CHECK_RATE_HZ = 1000.0
#: A limit is broken when it is exceeded by more than this share: rounding. evidence: double precision.
LIMIT_ROUNDING_SHARE = 1e-7
#: Steps of the bisection for the speed factor that keeps a torque limit: 2^-7 is finer than two digits of alpha.
#: evidence: that law.
ALPHA_BISECTIONS = 8

# ---------------------------------------------------------------- clearance on capsules
#: Random poses from which is learned which links always touch: those of a shoulder, elbow or wrist. evidence: none yet.
CAPSULE_LEARNING_POSES = 2000
#: Links that are near in more than this share of random poses meet in a joint, whose limits keep them apart.
#: evidence: none yet.
USUALLY_NEAR_SHARE = 0.2
#: Such links are watched too: they come no deeper into each other than in all but this share of random poses, except
#: for rounding [m]. evidence: none yet.
DEEPEST_POSES_SHARE, CAPSULE_ROUNDING_M = 0.05, 1e-3
#: An arm that is built lower than the wanted distance need only stay this much below what its best pose reaches [m].
#: evidence: none yet.
BUILT_LOW_M = 1e-3
#: A capsule is longer than its cylinder at both ends: capsules may come to this share of the wanted distance.
#: evidence: PyBullet checks the final motion with the cylinders.
CAPSULE_DISTANCE_SHARE = 0.75
#: The search keeps this much more than the wanted distance, because a penalty is never quite obeyed [m].
#: evidence: none yet.
SPARE_DISTANCE_M = 0.01
#: Distance short by this costs as much as the weight [m]. evidence: none yet.
CONTACT_SCALE_M = 0.05
#: Rounds of the golden section search along a segment. evidence: 0.618^40 is 4e-9 of its length.
GOLDEN_SECTIONS = 40
#: So far to both sides of the nearest point another direction is searched, as a share of the segment.
#: evidence: none yet.
KINK_SHARE = 1e-5

# ---------------------------------------------------------------- PyBullet as the check
#: Poses from which is learned which links always touch. evidence: none yet.
BULLET_LEARNING_POSES = 300
#: Pairs that are always near are watched for contact that is deeper than in every one of those poses by this [m].
#: evidence: none yet.
DEEPER_CONTACT_M = 0.005
#: Distances beyond this are not measured [m]. evidence: none yet; wanted distances are centimetres.
FARTHEST_MEASURED_M = 0.3
#: Largest difference between the frames of a user's URDF and those of the DH table [m and rad]. evidence: none yet.
SHAPES_WITHIN = 0.01
#: Poses that are measured for each second of the planned motion [Hz], and their number at most. evidence: none yet.
MEASURED_RATE_HZ, MOST_MEASURED_POSES = 100.0, 3000
#: A child that draws for so long, or a window that does not open for so long, hangs [s]. evidence: none yet.
DRAWING_TIMEOUT_S, WINDOW_TIMEOUT_S = 600.0, 60.0
#: Poses that the camera keeps in view. evidence: by eye.
CAMERA_POSES = 200

# ---------------------------------------------------------------- what a motion is searched by
#: Samples at which contact is checked, for each one of the regressor, and which of them that is. evidence: none yet.
CONTACT_SAMPLES_A_SAMPLE, MIDDLE_CONTACT_SAMPLE = 3, 1
#: Weight of penalties against a logarithmic cost: 0.2 % of overload, or ``CONTACT_SCALE_M`` / 550 of contact, all along
#: the path costs as much as 1 % of cost. evidence: none yet.
PENALTY_WEIGHT = 3000.0
#: The search leaves this share of a torque limit free, because a penalty is never quite obeyed. evidence: none yet.
SPARE_TORQUE_SHARE = 0.05
#: Power of the p-norm, ease of the penalties and iterations of each stage: smooth costs first, the cost itself last; a
#: motion may first pass through the floor and itself, or it would never get from one good region to another.
#: evidence: benchmarks/excitation.md as a whole.
STAGES = ((2.0, 0.01, 60), (8.0, 0.1, 60), (math.inf, 1.0, 200))
#: Costs without extreme eigenvalues are smooth as they are. A stage that comes twice forgets its curvatures between.
#: The first one is short and obeys everything, so that there is something to keep when the time is soon over.
#: evidence: benchmarks/excitation.md as a whole.
SMOOTH_STAGES = (
    (math.inf, 1.0, 60),
    (math.inf, 0.01, 100),
    (math.inf, 0.1, 100),
    (math.inf, 1.0, 100),
    (math.inf, 1.0, 100),
)
#: No cost of a motion that determines all parameters is so large; penalties are. evidence: none yet.
PENALISED_COST = 50.0
#: Time between two reports of the best so far [s]. evidence: a person reads no faster.
REPORT_INTERVAL_S = 0.5

# ---------------------------------------------------------------- collision-free search range
#: Share of random poses that shall be clear inside the range that is searched, and their number. evidence: none yet.
CLEAR_POSES_SHARE, RANGE_POSES = 0.5, 200
#: Half range that is not narrowed any more [rad or m]. evidence: none yet.
NARROWEST_HALF_RANGE = 0.4
#: Poses that are tried as the middle of that range, and how far around them it shall be clear [rad or m].
#: evidence: none yet.
RANGE_MIDDLES, RANGE_MIDDLE_REACH_RAD = 100, math.pi / 3
#: Values of each joint that must be passable, in which share of poses, and the poses in all of them.
#: evidence: none yet.
RANGE_SLICES, PASSABLE_SHARE, SLICED_POSES = 36, 0.04, 4000

# ---------------------------------------------------------------- from the search to a motion that may be shown
#: How far a motion is drawn towards the clear pose, step by step, until all checks pass. evidence: none yet.
SHRINK_SHARES = (1.0, 0.97, 0.94, 0.9, 0.8, 0.65, 0.5, 0.35, 0.2)
#: Samples along the path for each segment, and at least. evidence: none yet.
SAMPLES_A_SEGMENT, LEAST_SAMPLES = 12, 200
#: Rate at which contact is checked on the capsules [Hz]. evidence: none yet.
CONTACT_RATE_HZ = 50.0
#: Random poses among which a clear one is searched. evidence: none yet.
CLEAR_POSES = 400
#: Time for what comes after the search: this share of the whole, and this much at most [s]. evidence: none yet.
AFTER_SEARCH_SHARE, AFTER_SEARCH_S = 0.4, 14.0
#: Random motions among which one is taken without a search. evidence: none yet.
RANDOM_MOTIONS = 20

# ---------------------------------------------------------------- what a motion will teach
#: Torque noise of a joint that nobody has measured, as a share of its rating. evidence: sensors of a KUKA LWR4+.
NOISE_SHARE_OF_RATING = 0.003
#: Torque noise of a joint without a rating [N m]. evidence: none yet.
NOISE_WITHOUT_RATING = 0.1
#: The other motions on which the expected torque error is meant: so many random Fourier motions inside the limits, of
#: this length [s] and so many harmonics. evidence: none yet.
OTHER_MOTIONS, OTHER_DURATION_S, OTHER_HARMONICS = 12, 10.0, 5
#: The recommended sequence of speed factors. evidence: none yet; slow first.
RECOMMENDED_ALPHAS = (0.2, 0.5, 1.0)
#: Samples of a motion that its row of the table is computed from. evidence: none yet.
ALPHA_TABLE_SAMPLES = 1000

# ---------------------------------------------------------------- the motion that answers a gap search
#: Samples along the run, 20 a second of the planned motion of usual length, and random motions for each start.
#: evidence: none yet.
RUN_SAMPLES, TRIALS_A_START = 1200, 60
#: Shapes of a rival that are tried: the best imitation counts. evidence: none yet.
RIVAL_SHAPES = 12
#: Independent rows a second that are left of a torque after the filter of the search. evidence: none yet.
INDEPENDENT_ROWS_A_SECOND = 20.0
#: A rival's directions below this share of the largest are rounding noise. evidence: double precision.
WEAK_DIRECTION_SHARE = 1e-9
