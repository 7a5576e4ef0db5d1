"""What decides in this folder: thresholds, shares, counts and times, each with its unit and what it rests on.

In the order in which a log meets them: names, stamps, repeats, motion, same motion, values, velocity, ranges, cut-off,
spikes, sign of the velocity, conditioning, thinning.
"""

#: Names that share this much are taken for the same joint. Evidence: none yet.
ALIKE_NAMES = 0.6

#: A step of this many sample times is a gap: the low-pass, about five samples long, cannot bridge more.
GAP_SAMPLES = 5.0
#: With more than one sample in twenty missing the resampled grid is mostly interpolation where it matters.
LOST_SHARE = 0.05
#: A step longer than this [s] is a pause of the recording, not samples that were lost. Evidence: none yet.
PAUSE_S = 0.5
#: Two stamps in a hundred may fall together on a busy machine; one in five means that the clock is too coarse.
DUPLICATE_SHARE = 0.2
#: Below this rate [Hz] the step of the friction at a reversal falls between two samples. Evidence: none yet.
LEAST_RATE_HZ = 20.0
#: The cut-off must stay below 80 % of half the rate: 2 / 0.8.
SAMPLES_PER_CUTOFF = 2.5
#: Share of the sample rate from which on a motion is no motion but jumps from pose to pose. evidence: poses without the
#: motion between reach 0.42 to 0.5, moves of a quarter of a second at 50 Hz 0.09.
JUMPS = 0.4
#: Rate [Hz] that is comfortable for an arm, named in the advice. Evidence: none yet.
GOOD_RATE_HZ = 50.0
#: Fewer samples than this are no recording, and fewer in motion show nothing. Evidence: none yet.
LEAST_SAMPLES = 20
#: No driver publishes faster [Hz]: the fastest reach 10 kHz.
FASTEST_HZ = 1e5
#: No clock shows a later time [s]: 30 000 years.
LATEST_S = 1e12
#: Positions that bend less than this share on an even clock of what they bend on their stamps were taken evenly.
#: Evidence: none yet.
STRAIGHTER = 0.5
#: Stamps that stray by less than this share of a sample time are corrected without a finding. Evidence: none yet.
STRAY_WORTH_SAYING = 0.05

#: Share of the samples in motion that must be repeats: one in twenty narrows intervals by 3 %.
STALE_SHARE = 0.05
#: Of the joints that move, this share changes at nearly every new sample where samples are held as a whole.
#: Evidence: none yet.
CHANGE_TOGETHER = 0.8
#: Half of the time [s] that a speed is taken over: encoder steps vanish, the fastest arm motions (3 Hz) do not.
SPEED_WINDOW_S = 0.05
#: Faster than this the joint moves [rad/s, m/s]: ten times what encoder noise makes over the window. Evidence: none
#: yet.
MOVING_SPEED = (0.02, 0.002)
#: Slower than this it rests [rad/s, m/s]. Evidence: none yet.
REST_SPEED = (0.01, 0.001)
#: A rest shorter than this [s] still has the arm's own vibration in it. Evidence: none yet.
ARM_REST_S = 0.3
#: A joint that spans less [rad, m] has not moved: Coulomb friction is not even broken loose. Evidence: none yet.
STILL_SPAN = (0.01, 0.001)
#: Share of the velocity's power that defines the fastest motion. Evidence: none yet.
POWER_SHARE = 0.99
#: Swings (from one reversal to the next, summed over joints) below this share of the number of parameters are too
#: few: each swing gives about four independent numbers (two accelerations, speed, position). One per parameter is
#: plenty.
FEW_SWINGS_PER_PARAMETER = 0.4
#: Below this share, about one swing a joint, or with less motion [s], no prior makes an identification of it.
#: Evidence: none yet.
SWINGS_PER_PARAMETER, LEAST_MOTION_S = 0.1, 1.0
#: Base parameters of the rigid bodies per joint, on average; a seven-joint arm has 48.
BASE_PER_JOINT = 7

#: Rate at which positions are compared [Hz]. Evidence: none yet.
MOTION_HZ = 5.0
#: Of a pause in a recording, no more than this is compared [s]: it has no samples, however long it is. Evidence: none
#: yet.
MOTION_PAUSE_S = 1.0
#: Two motions are the same when the positions of every joint differ by at most this share of its range . Evidence:
#: none yet.
SAME_MOTION = 0.05
#: ... over at least this share of the shorter one, wherever in the other it begins. Evidence: none yet.
SAME_OVERLAP = 0.7
#: A joint that moves by less than this share of the largest range counts as still. Evidence: none yet.
SAME_STILL = 0.02

#: An arm may overrun its limits a little; degrees overrun them 57 times.
BEYOND_RANGE = 1.2
BEYOND_SPEED = 3.0
#: Torque sensors go to about 1.5 times the rating before they saturate; three times it is another unit.
BEYOND_RATING = 3.0
#: A jump by a full turn is recognised when what is left of it is below this [rad]. Evidence: none yet.
TURN_REST = 0.5
#: So many equal samples in a row at the largest value are a flat top: a motion passes its peak in one or two.
FLAT_RUN = 5
#: At a flat top the largest value is this many times as frequent as the next one; at a quantised peak 1.4 times.
FLAT_SHARE = 3.0
#: No sensor reads more in any unit, and none of torques so little; a flipped bit in a bag, which carries no checksum,
#: does.
LARGEST, LEAST_TORQUE = 1e9, 1e-9
#: Bad samples closer than this [s] go into one --exclude; more intervals than MOST_INTERVALS into one for all.
#: Evidence: none yet.
EXCLUDED_TOGETHER_S = 0.2
MOST_INTERVALS = 4
EXCLUDE_MARGIN_S = 0.001
#: A joint carries no weight when its expected torque is below this share of the largest of any joint. Evidence: none
#: yet.
UNLOADED = 0.02
#: Torque sensors of healthy arms are zero within 1 % of the rating; three times that is worth zeroing.
ZERO_SHARE = 0.03

#: Slope of measured velocity on the change of position: tried on simulated motions it stays in 0.92-1.01, and drops
#: to 0.58 with heavy noise; so these bands mean another unit or sign, nothing else.
SLOPE_DEGREES = (30.0, 90.0)
SLOPE_RADIANS = (0.010, 0.030)
SLOPE_REVERSED = (-1.5, -0.5)
#: Slopes outside this band are not noise any more, but no known unit either. Evidence: none yet.
SLOPE_AGREES = (0.8, 1.25)
#: Correlation of a joint's velocity with its position's slope between those of a wrong column, up to 0.73 with a joint
#: of the same motion, and of a right one, above 0.9 unless very noisy.
WRONG_COLUMN = 0.75

#: Positions this far beyond a limit are no rounding of a data sheet [rad or m]. Evidence: none yet.
BEYOND_LIMITS = 0.1

#: The cut-off lies this many times above the band of the motion: Coriolis products double frequencies, and reversals
#: of friction add harmonics. Evidence: none yet.
CUTOFF_OVER_MOTION = 5.0
#: Lowest cut-off chosen from the band alone [Hz]: slow motions have friction reversals as sharp as fast ones.
#: Evidence: none yet.
LOWEST_CUTOFF_HZ = 5.0
#: Share of noise in the accelerations of a joint up to which intervals hold: inertias come out smaller by its square.
#: Evidence: parameters inside 95 % intervals at 0.12, 0.08, 0.05: 57, 83, 94 % of an arm with 1.6e-4 rad at 1 kHz, 97,
#: 97, 95 % of one with 1e-4 rad at 100 Hz; unseen errors 1.04, 0.72, 0.55 and 1.2, 1.0, 1.0 %.
NOISE_SHARE = 0.08
#: Cut-offs that are tried [Hz]: lower ones would leave next to nothing of any motion. Evidence: none yet.
LOWEST_TRIED_HZ, TRIED_STEP_HZ = 1.0, 0.25

#: Kaiser window for 60 dB: what is left of the stop band is a thousandth, below the noise of any joint sensor.
KAISER_BETA = 5.65
KAISER_TAPS = 3.6
#: Samples on either side that a torque sample is compared with. Evidence: none yet.
SPIKE_REACH = 2
#: A spike is this many standard deviations of such differences away from the median, and this share of the joint's
#: range: noise is not the first, what is not the second does no harm. Evidence: none yet.
SPIKE_DEVIATIONS, SPIKE_OF_RANGE = 8.0, 0.05
#: Where more samples than this share look like it, they are no accidents. Evidence: none yet.
SPIKE_MOST = 0.03
#: The window is at most this share of the period of the cut-off: a slower log may show a motion in five samples.
#: Evidence: none yet.
SPIKE_OF_PERIOD = 0.25

#: Noise of the velocity over the velocity of the Coulomb sign: less and it hardly blurs the step. Evidence: none yet.
NOISE_OVER_COULOMB = 0.25
#: Sharper than this nothing is gained [Hz]: a reversal lasts a few milliseconds. Evidence: none yet.
SHARPEST_HZ = 100.0
#: Highest cut-off over the sample rate, and the ratio of two cut-offs that are tried. Evidence: none yet.
SIGN_OF_RATE, SIGN_RATIO = 0.4, 2.0**0.5
#: Differences of this order see encoder noise and nothing of the motion. Evidence: none yet.
NOISE_ORDER = 6

#: The position filter's cut-off over the cut-off of the parallel filter. Evidence: none yet.
POSITION_OVER_PARALLEL = 4.0
#: Samples per cut-off period that the regressor is evaluated at, and that are kept after the parallel filter.
#: Evidence: positions pass up to 6 cut-offs and rows up to 1.5, so that from 7.5 on nothing folds back. With 20, unseen
#: errors of 32 pairs of recordings are 0.7 % larger in the mean (-2.3 to +4.7 %).
EVALUATED_PER_CUTOFF = 8.0
KEPT_PER_CUTOFF = 4.0
#: How many times as many rows may be kept for a coarser evaluation. Evidence: with 1.25 the spring of joint 7 of the
#: LWR4+ is no longer found.
KEPT_MORE = 1.2
#: A joint is at rest when it stays slow for this long [s]; a reversal is shorter. Evidence: with 0.15 at the same speed
#: the UR10 is predicted 23 and 34 % worse, for its slow reversals are gone.
FRICTION_REST_S = 0.25
#: Shares of this time and of the speed that make a rest: at all of them a reversal of the same acceleration is none.
#: Evidence: with 0.4 two simulated arms with short stops are predicted to 0.6 and 0.3 instead of 7.4 and 1.3 %, the
#: UR10 1 to 2 % better.
REST_SHARES = (0.4, 1.0)
#: Stamps that stray from an even grid by less than this share of the step are taken as even. Evidence: none yet.
EVEN_STEP = 1e-3
#: Steps that are added up before they are counted: single ones are too uneven to show how many sample times they are.
#: Evidence: none yet.
RATE_STEPS = 20

#: Parts that are kept of each segment of a long log: long ones, so that a motion that repeats in it is still found.
#: Evidence: none yet.
KEPT_STRETCHES = 4
#: Samples of all logs together that are kept however long they take. Evidence: none yet.
KEPT_SAMPLES = 20_000
#: Torques that are differentiated twice are smoothed beyond this [Hz]: they follow accelerations already, and above
#: it the fourth derivative of the positions is their noise, which makes what is fitted to it too small. Evidence:
#: none yet.
EFFECT_SMOOTHING_HZ = 4.0

#: A log that begins so soon after the recordings that an effect of time was found in is of the same session, and its
#: clock is theirs [s]. Evidence: none, an hour.
SESSION_S = 3600.0

# Speed and memory: no result depends on them, but for the last digits.
#: Samples at the beginning of a log of which noise and steps of torque are estimated. Evidence: none yet.
ENOUGH_SAMPLES = 1 << 18
#: Samples for each value of a torque from which on it is recorded in steps; noise of a step alone leaves about ten.
VALUES_OF_STEPS = 20
