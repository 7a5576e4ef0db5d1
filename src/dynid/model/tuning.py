"""The numbers of this folder that decide something: unit, meaning, evidence."""

# ---------------------------------------------------------------- evaluation of the regressor
#: Samples a block: enough to hide the cost of starting an array operation, few enough for the processor's cache.
#: evidence: none yet.
BLOCK_SAMPLES = 2048

# ---------------------------------------------------------------- base parameters
#: A normalised column left with less than this after projection on the ones before it depends on them. evidence: on
#: random states the kept singular values end at about 0.2 and the dropped ones begin at 5e-15: anything between serves.
DEPENDENT_COLUMN = 1e-9
#: A column whose norm is below this share of the largest, and a coefficient below this share of the largest of its
#: relation, are rounding. evidence: as for DEPENDENT_COLUMN.
ROUNDING_SHARE = 1e-9
#: Standard deviation of the random speeds and accelerations [rad/s, rad/s^2]: no column is small then.
#: evidence: none yet.
RANDOM_STATE_SPREAD = 2.0
#: A dropped singular value above this share of the largest is no rounding. evidence: it is
#: at most 7e-15 on 54 arms of 3 to 12 joints.
ROUNDED_VALUE = 1e-13
#: A sum below this share of the sizes that it is made of is zero. evidence: rounding of some ten terms.
CANCELLED = 1e-12

# ---------------------------------------------------------------- the prior of a robot file without one
#: Radius [m] and density [kg/m^3] of a link: between aluminium tubing and plastic covers, drives included.
#: evidence: none yet; the fit gives the mass its own scale (estimation).
DEFAULT_LINK_RADIUS_M = 0.06
DEFAULT_LINK_DENSITY = 1200.0
#: Mass of a link about which nothing is known [kg]. evidence: none; only the pattern over poses is used.
UNKNOWN_LINK_MASS_KG = 1.0

# ---------------------------------------------------------------- a URDF as a DH table
#: Axes that are closer to parallel than this are parallel [rad]; angles below 1e-4 rad were made exact before.
#: evidence: none yet.
PARALLEL_AXES_RAD = 1e-7
#: Lengths below this are zero [m]. evidence: none yet.
ZERO_LENGTH_M = 1e-9
#: Least second moment of a body along an axis, as a share of the largest: a plate is not infinitely thin.
#: evidence: none yet.
THINNEST_BODY_SHARE = 1e-3

# ---------------------------------------------------------------- shapes that effects are tried with
#: A joint that travels less does not move [rad]. evidence: none yet.
STILL_JOINT_RAD = 0.1
#: Radians of phase over the travel of the slowest wave that counts as one: below, it is a spring. evidence: none yet.
SLOWEST_WAVE_PHASE_RAD = 10.0
#: Radians of phase over the travel between neighbouring waves that are tried: refinement finds what lies between.
#: evidence: none yet.
WAVE_SPACING_RAD = 3.2
#: Fastest wave of torque [1/rad]: harmonic drives have up to some 200 teeth. evidence: their data sheets.
FASTEST_WAVE = 230.0
#: The same for waves of friction: faster ones are smoothed away by the filter before they pass for friction.
#: evidence: none yet.
FASTEST_FRICTION_WAVE = 120.0
#: How often the bend of an elastic joint is found again from the torque where it is bent. evidence: none yet.
BEND_ITERATIONS = 3
#: A link that has not crossed a gap of backlash after so many samples rests between its flanks. evidence: none yet.
LONGEST_FLIGHT_SAMPLES = 400
