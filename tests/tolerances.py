# SPDX-License-Identifier: GPL-3.0-or-later
"""Every tolerance that a test compares with, and the reason for its size.

A test names its tolerance from here; none is written into a test. Relative where the name says so,
else in the unit of what is compared.
"""

from __future__ import annotations

# Metrics: float64 sums over at most a few million pixels; what is left is the rounding of one division.
METRIC_RELATIVE = 1e-9

# Camera solved from Position and Depth. Both are stored as float32: at 1e3 units from the origin a
# pixel's position is known to 6e-5 units, which is below this for every frame that a test makes.
SOLVED_POSE_PX = 0.02
SOLVED_ROTATION = 1e-5

# Normals: unit vectors rotated by a float32 matrix.
UNIT_NORMAL = 1e-5

# Half floats hold 11 bits of mantissa.
HALF_RELATIVE = 2.0**-11

# Compositor: a handful of float32 operations on values below 10 (measured at most 1e-6), and the
# contract's bound.
COMPOSITED = 1e-4

# Demo scene: the share of pixels that get most of their light from bounces, or the effect would not show
# (measured: 0.79 at 64 samples, 0.87 denoised).
DEMO_MOSTLY_BOUNCED = 0.7

# Where a captured point projects to, against its pixel's centre: the sample's jitter (0.005) and float32.
REPROJECTED_PX = 0.01

# Depth and normals of planes that stand at known places, relative to one unit.
CAPTURED_GEOMETRY = 1e-5

# Roughness of a pixel. An AOV holds it to float32; the denoising passes lose digits where the diffuse share
# is large, since it is subtracted (measured 0.004 at 4 % glossy and 80 % diffuse colour).
ROUGHNESS_AOV = 1e-5
ROUGHNESS_DENOISING = 0.01

# Sums of light passes against Combined, relative to the brightest pixel: float32 sums of few terms.
PASS_SUM_RELATIVE = 1e-5

# Light of one sample against light of many: what noise leaves of a mean over some hundred pixels, relative.
MEAN_OF_NOISY_PIXELS = 0.1

# Depth of a pixel's one sample against the surface at its centre, relative: the sample's jitter
# (0.005 pixels of a face with 12) on surfaces that stand askew.
SURROUND_DEPTH = 0.01

# Distance from a front to a back face, scene units, at 5 units from the camera: two float32 depths, two
# jitters of 0.005 pixels on sides that stand askew, and the facets of a ball.
BACK_FACE = 1e-3

# Radiance of a surface that another one hides, against the same light without it in the camera's way: the
# same samples of the same lamp, and their rounding.
PEELED_LIGHT = 1e-5

# Distances along rays, relative, after a float64 walk and its scalar twin, which sum in another order.
FLOAT64_DISTANCE = 1e-6

# What some dozens of roundings of float64 make of a place or a direction of order 1.
FLOAT64_ROUNDINGS = 1e-14

# The same after a float32 walk, and the share of rays that rounding sends through another cell, so that they
# meet another surface of a rough depth field.
FLOAT32_DISTANCE = 1e-4
FLOAT32_RAYS_THAT_DIFFER = 2e-3

# A ball of pixels' patches is not quite convex: rays along it may graze the corner of a patch.
CONVEX_SELF_HITS = 5e-4

# Projection there and back in float64, relative to the image and to the coordinate.
PROJECTION_RELATIVE = 1e-9

# Angles by float32 arctan2 and arccos, relative to a turn.
ENVIRONMENT_LOOKUP = 1e-6

# Means over thousands of evenly spread sample points against their integrals.
HEMISPHERE_MOMENT = 2e-3
# The same for a lobe's 65,000 grid points, against a quadrature of 180,000.
LOBE_MOMENT = 2e-3

# A filter's weighted mean of float32 values, relative (or absolute, of light of 1).
FILTER_RELATIVE = 1e-5

# The white furnace: every ray brings exactly 1, what remains is the rounding of a mean and of filter weights.
FURNACE = 1e-5
# The diffuse pass with 1024 rays against a grid of 288 directions: light up to 2, visibility up to 1. Both
# sample edges, so a pixel may be off by some rays.
GATHERED_PIXEL = 0.06
GATHERED_MEAN = 0.015
# Means over many rays and pixels against integrals, relative.
CLOSED_FORM_RELATIVE = 0.02
# Error per pixel of the preset "final" against closed forms, root mean square relative to their mean: what
# the filter leaves of the noise (measured: openness 0.005 to 0.010, sunlight 0.0003, a floor's
# light from a wall 0.027 to 0.028 at 192 x 144, with a bias of 0 to 0.007).
CLOSED_FORM_RMS = 0.05
# The same of a floor's light from a wall that stands on it, bias and rms, more than two rows from the crease,
# 96 x 72: light falls to a half within the filter's reach of 15 pixels, and the filter carries some of the
# brightest rows on (measured: 0.024 and 0.050 by rays, 0.020 and 0.046 by sectors, 0.027 and 0.051 below a
# horizon; unfiltered the bias is 0.001, -0.002 and 0.004).
FILTERED_BEFORE_WALL = (0.03, 0.055)
# What a floor receives from a ball lit from the camera, bias and rms, 160 x 120. Rays: the bias of any
# closed form, and what the filter leaves of their noise (measured: -0.004 and 0.055; 0.015 with 512 rays); 48
# steps stand for broad patches (measured: -0.053 and 0.083; 0.014 with 128 steps); a horizon takes all
# below the ball for lit (measured: 1.57 and 1.72).
BALL_BOUNCE = {"hemisphere": (CLOSED_FORM_RELATIVE, 0.06), "bitmask": (0.07, 0.1), "horizon": (1.7, 1.9)}
# Openness of that floor where everything is infinitely thick, bias and rms (measured: 0.091 and 0.127).
BALL_BELOW_HORIZON = (0.1, 0.14)
# White furnace of albedo 1/2 after eight bounces: some 2^-8 are missing (measured 0.0048).
FURNACE_BOUNCED = 0.005
# A sun's light in a ball's umbra, relative to full light: the part below the bright sky's limit, which rays
# over the hemisphere sample and the filter spreads (measured: 4e-5 on average, 4e-4 at most).
SUN_IN_UMBRA = 1e-3
# Visibility within six pixels of a contact, 4 rays and filter against 512: squared error left of 4 rays
# alone, and bias (measured: 0.40 and 0.081 around a ball, 0.12 and 0.033 around a box, 96 x 72; the filter's
# first three passes are blind to a shadow that is narrower than their reach, and it goes by light, to which
# the ball's unseen side brings the environment).
CONTACT_ERROR_LEFT = {"ball": 0.45, "box": 0.17}
CONTACT_BIAS = {"ball": 0.095, "box": 0.045}
# The same float32 sum in another order, relative.
REPEATED_SUM = 1e-5

# A mirror shows whole pixels: the centre of the one it met is half a pixel off at most, or, where the
# crossing lies on a border between pixels, in the next one.
MIRROR_HIT_PX = 1.0
# Share of a mirror's pixels that show the neighbour of the pixel that geometry says.
MIRROR_PIXELS_OFF = 0.01
# A lobe's mean of 1024 rays against its integral: light up to 2.5, most of it from whole pixels of a texture.
LOBE_PIXEL = 0.03
# What changes on average between an exact mirror and the least rough lobe, of a texture of 0.5 to 2.5.
MIRROR_AT_MIRROR_LIMIT = 0.01
# Share of a mirror's pixels that show a ball although their ray passes it: its rim pixels are small plates.
MIRROR_HALO = 2e-3

# Means of light after all lengths were multiplied by a number that rounds in float32.
SCALED_SCENE_RELATIVE = 1e-4
# Mean difference per pixel between parallel rays and those of a camera 2,000 widths away, of light about 1.
PARALLEL_AS_FAR_AWAY = 0.01

# A frame cut in three against the whole: rays near the cuts start or end in pixels with other neighbours,
# mean difference relative to the mean.
SPLIT_FRAME = 0.02
# Where a mirror's ray meets a wall, in scene units: hits are whole pixels, of 0.08 to 0.16 units askew.
VIEW_HIT_UNITS = 0.2

# Mean light against Cycles with as many bounces, of the whole picture and of its indirect share alone, from
# a frame, its surround and stations (measured: 0.99 to 1.00, and 0.95 to 1.01; without stations 0.89 in the
# open field, whose ball lights the ground with a side that the camera cannot see).
# Through EEVEE all light of emissive meshes and of the world is ours (measured: 0.99, 1.01 and 1.03, and
# 0.99, 1.01 and 1.07: an emitter of few pixels looks larger to rays by the rim of its patches).
ACCOUNTED_COMBINED = {"cycles": 0.05, "eevee": 0.1}
ACCOUNTED_INDIRECT = {"cycles": 0.1, "eevee": 0.1}

# Mean of pixels that show the sky or an emitter almost alone.
EMITTED = 0.01

# A mirror against its reflection in closed form, 480 x 270. Light, mean error relative to the contrast of a
# texture with periods of 12, 24 and 48 pixels: the required bound. Colours between pixels at exact places
# leave 0.001 to 0.0025, whole pixels 0.008 to 0.025.
MIRROR_LIGHT_OF_CONTRAST = 0.005
# Share of the reflections that the frame shows elsewhere and that are found: the required bound (measured
# 0.999; the rest runs along the wall's edge).
MIRROR_VISIBLE_KNOWN = 0.99
# Share of a mirror's pixels that show light where there is sky: a wall's edge is as wide as the patch of a
# pixel (measured 0.003).
MIRROR_EDGE_LIGHT = 0.005

# Share of an interior's rays that the benchmarks' compiled tracer sends elsewhere than the walk, and of the
# cells that they look at: both round alike (measured 0), but compilers may contract products and sums.
COMPILED_RAYS_THAT_DIFFER = 1e-4

# The glossy light of lobes up to roughness 0.4, of 64 rays a pixel against 128 samples of Cycles: relMSE
# (measured 0.0002 to 0.003, noise for the most part).
LOBE_RELMSE = 0.01
# The same of wider lobes, few of whose rays meet the wall (measured 0.011 and 0.045, of which the reference's
# own noise is a fifth).
LOBE_RELMSE_VERY_ROUGH = {0.7: 0.02, 1.0: 0.08}
# Mean of that light against Cycles', relative. From the frame alone it lacks up to a tenth of a lobe, and
# pixels whose rays happened to be answered are brighter than others (measured at most 0.9 %). With a surround
# what is left is noise (measured at most 0.4 %; lobes without masking, or with twice as much, are off by 1 to
# 3 %, and colours mixed across the edge between wall and floor by 1 %).
LOBE_BIAS = 0.02
LOBE_BIAS_ANSWERED = 0.005
# What four times the rays leave of the error: a quarter of the variance of independent rays (measured 0.15 to
# 0.22, and 0.37 from 1 to 4 rays of roughness 1, where some pixels' only ray goes below the surface).
LOBE_ERROR_LEFT = 0.6

# A march in steps of a pixel against the exact walk: share of rays with another status (measured: at most
# 0.0072, among floor, wall and ball; the walk sees the corners of pixels between two samples).
MARCH_RAYS_THAT_DIFFER = 0.01

# Where in a frame of some tens of pixels a float32 ray meets a pixel, and a float64 one.
FLOAT32_POSITION_PX = 1e-3
MET_POSITION_PX = 1e-6

# Rays for every 2 x 2 or 4 x 4 pixels against rays for every pixel, on a floor before a wall: mean difference
# as a fraction of the mean light (measured: 0.05 at a quarter of the resolution).
FEWER_RAYS_LIGHT = 0.07

# Rays borrowed at an edge of a surface against the pixel's own: largest difference as a fraction of the
# brightest light. Both are noise of 256 rays; a leak over the edge would be of the order of 1.
BORROWED_LIGHT = 0.1

# The same with the default settings, which read cones and take neighbours' rays: both blur what a very rough
# floor reflects of the wall's lower edge (measured: 0.0054 at roughness 1).
LOBE_BIAS_DEFAULTS = 0.01

# Mirrors that show a gradient of 1 per unit between the pixels of a wall 4 units away, or of a view's 4 units
# behind the camera: float32 hits and sums of light of 10 (measured 7e-7 and 2e-5; whole pixels are 0.02 and
# 0.07 off).
SUBPIXEL_LIGHT = 1e-4
# Noise that is left in the mean of a cell with four times as many pixels, each independent: half, and what a
# few cells of 16 x 16 make of it.
CONE_NOISE_LEFT = 0.7
# Squared error of one cone per pixel, relative to that of one thin ray, before a wall of noise (measured 0.32
# and 0.56).
CONE_ERROR_LEFT = 0.7
# The same of 64 a pixel: few of them are wider than a pixel (measured 1.002 and 0.99).
CONES_OF_MANY_RAYS = 1.02

# Squared error that the rays of eight neighbours leave: nine times the rays would leave a ninth, but they
# weigh unevenly (measured: 0.20 at roughness 0.3, 0.11 at 0.6; 1 without neighbours, and 0.26 at roughness
# 0.3 where rays that find nothing have no weight).
BORROWED_ERROR_LEFT = 0.25
# Share of a lobe that is known, from neighbours' rays against the pixel's own. A borrowed ray counts at most
# four of the pixel's own, and is turned toward its hit but keeps the density that it was drawn with; both
# take weight from hits (measured: at most 0.019, of which the bound is 0.010; 0.033 to 0.074 with a bound
# of 1).
KNOWN_WITH_BORROWED = 0.025
# Error of a sharp pixel among rough ones, relative to how far off the rough ones' light is: mostly the noise
# of 16 rays, which without neighbours is 0.011 (measured: 0.022 and 0.037; 0.68 and 0.81 where borrowed rays
# do not count by the receiver's lobe).
SHARP_COLUMN = 0.05
# Squared error that neighbours leave of sharp pixels beside rough ones: few of their rays lie in the sharp
# lobe (measured: 0.59; 0.93 with no bound on the weight of one that does, 1.3 with a bound of 1).
BORROWED_BY_SHARP_LEFT = 0.75
# Contrast that borrowed rays leave of stripes at the contact with what shows them. A period is four pixels,
# and rays come from up to three away (measured: 0.80 to 0.97; 0.20 to 0.22 where they are not turned toward
# what they found).
CONTRAST_AT_CONTACT = 0.7
# Light of 1 that rays borrowed over a ledge would bring, mean error over four rows: noise of 32 rays, at half
# the resolution of a quarter of them (measured: 0.020 to 0.059; 0.16 to 0.29 where neighbours off the pixel's
# plane count).
BEHIND_LEDGE_LIGHT = 0.1

# What 65,536 drawn directions bring against a quadrature of a million, relative to the mean brought.
SKY_MOMENT = 5e-3
# Light of a sun by 256 shadow rays against that by 4096 rays over the hemisphere: mean difference per pixel,
# relative to the mean. Both are noise (measured 0.026, and 0.021 between two seeds of the latter).
SKY_AS_BY_HEMISPHERE = 0.05
# Light of shadow rays of a view, and of the same view as the frame: float32 directions through another
# rotation send single rays past another edge.
TURNED_VIEW_RELATIVE = 1e-3

# theta - sin cos by a polynomial of degree 7, radians (measured: 1.06e-3, of up to pi).
ARC_POLYNOMIAL = 1.1e-3
# Sectors of 32 that a direction has passed after 14 bisections of a cosine.
DRAWN_SECTOR = 0.05
# Share of the hemisphere that a plane covers of itself by the rounding of single sectors.
LONE_PLANE = 1e-3
# Slices against rays, mean light (up to 2) and shares of the hemisphere over a frame of 32 x 24.
SLICED_AS_TRACED = 0.02
# The same through another view, which one drawn direction per pixel looks into, relative.
SLICED_BEYOND = 0.05

# The world's panorama against the colour of each direction, 0 to 1: bilinear between pixels of 1.4 degrees.
PANORAMA_LIGHT = 2e-3
# A sun of whole pixels of a panorama: its light is their sum in another order; its direction is off by the
# unevenness of its rim, radians.
SUN_IRRADIANCE = 1e-4
SUN_DIRECTION = 0.01

# EEVEE's colours: half floats that are cut off, not rounded.
EEVEE_HALF = 2.0**-10
# EEVEE against Cycles. Depth of a slanted surface, relative (measured 1e-5): Cycles' sample lies up to 0.005
# pixels off the centre. Normals and AOVs are half floats. At edges the two may draw different surfaces.
EEVEE_DEPTH = 1e-4
EEVEE_NORMAL = 2e-3
EEVEE_SILHOUETTE = 0.01
ROUGHNESS_AOV_HALF = 1e-3
# The mean light of a lamp with soft shadows, EEVEE's of 4 samples against Cycles' of 64, relative (measured,
# of five kinds of lamps: 0.98 to 1.02).
EEVEE_LAMP_LIGHT = 0.05
# What a plastic floor hands on of its colour: float32 (measured 2.4e-7; at grazing angles half of the colour
# is missing where gloss keeps its part).
WHOLE_COLOR = 1e-5
# Diffuse light of one bounce in a room of glossy walls against Cycles, at known pixels, relative (measured:
# +0.017, where the same room of matte walls has +0.023, and -0.049 where gloss keeps its part).
GLOSSY_ROOM_LIGHT = 0.03

# Bias of 16 rays a pixel against 256 with another seed, all pixels of a room together (measured: 0.008; light
# of one bounce more is 0.13 and more).
BIAS_OF_FEW_RAYS = 0.02

# Share of the tracer's hits that are right in an open corridor with a ball, at 96 x 72 (measured: 0.965; the
# rest lies at the rim of the ball, at contacts and behind the ball).
TRUE_HITS_RIGHT = 0.95
# Distances of up to 10 units that Blender's float32 casts return.
UNIT_HIT = 1e-5
# What is left of the noise of 16,384 pixels of three channels in an error that should hold none, relative to
# what it would add: three standard deviations are 0.03, leaving out the largest 0.1 % is 0.004.
NOISE_LEFT = 0.05
# A filled white furnace of 64 rays, filtered, of which a half is hidden: how much is known changes faster
# before a wall than a fill's pixels tell, and the rays' light with it (measured: mean off by 0.004, rms 0.084
# and 0.184; 0.5 to 0.7 without a fill).
FILLED_FURNACE = {"mean": 0.02, "diffuse": 0.1, "glossy": 0.2}
# Light at the level of a fill of a quarter of the pixels each way, absolute, of light below 1.2: what both
# filter and the way there and back flatten near borders (measured: 0.024).
SPARSE_LEVEL = 0.03
# Mean of visibility and of what is known, of 4 rays at a sixteenth of the pixels beside 64 at all of them
# (measured: 0.004 and 0.006).
FEW_VISIBILITY_RAYS = 0.02
# Share of its error that a mixed pixel keeps: it and two others beside it weigh three tenths of clean ones
# (exact: 0.13).
MIXED_LIGHT = 0.15
# Squared error of a denoised fill of one sample beside that of as many light paths as they are, at the same
# size (measured: 0.063).
DENOISED_FILL = 0.25
# The same light from two places, relative: their borders flatten a slow gradient elsewhere (measured: 0.034).
CARRIED_FROM_ELSEWHERE = 0.05
# Noise of eight fills together, each with a deviation of 1: 8^-1/2, less for what carrying over smooths;
# and what it leaves of the mean of some hundred pixels.
MERGED_NOISE = 0.4
MERGED_MEAN = 0.05
# Indirect light of a glowing room against its closed form, relative: noise of 256 paths a pixel, and what the
# limit on fireflies takes.
FURNACE_OF_CYCLES = 0.03
# Mean of a filled picture against Cycles with the same direct light, relative: noise of 64 samples.
FILLED_PICTURE = 0.03
# Two hits of a ray that are one surface, seen by two views: within their pixels, relative.
SAME_HIT = 0.02
# Share of an interior's rays whose status, and share of the hits whose surface depends on the order of four
# views from elsewhere. The first view that sees a ray all the way to a surface ends the search, and views
# disagree at rims and contacts (measured: below 0.01, and 0.048 with views of 48 x 48 pixels).
ANSWERS_BY_ORDER = 0.01
DISTANCES_BY_ORDER = 0.06
# Pixels that a size is off where it has to be a whole number of them.
SIZE_IN_WHOLE_PIXELS = 0.5
# Share of the wall behind a box that the first station sees, and the first four together; it is chosen for
# the most rays, which also end at the box's back and on the floor (measured: 0.36 and 0.88).
HIDDEN_WALL_SEEN = 0.25
HIDDEN_WALL_SEEN_BY_FOUR = 0.8
# Share of the rays that a frame and its surround answer wrongly or not at all, and that stations win back
# (measured: 0.34 and 0.69).
LOST_RAYS_WON_BACK = {"one": 0.2, "four": 0.5}
# Light through a lamp's view of 96 x 96 pixels against the sum over them, relative. Mean of all receiving
# pixels: rays over the view's border meet what lies up to half a pixel beside it (measured: 0.017 and 0.020).
# Root mean square of each: noise of 256 rays, few of which meet the lit surface (measured: 0.03 and 0.09).
LIGHT_VIEW_MEAN = 0.025
LIGHT_VIEW_PIXEL = 0.11
# What eight times as many pixels each way leave of the error of the mean: an eighth, and noise (measured:
# 0.16 and 0.11).
LIGHT_VIEW_BIAS_LEFT = 0.3
# Share of that light that a board takes away: the error of the mean, and half a pixel around the board
# (measured: off by 0.018 and 0.010).
LIGHT_VIEW_SHADOW = 0.03
# A lamp's irradiance as that of a point against Cycles, straight below it, relative: noise of 64 samples, and
# the lamp's size (measured: at most 0.02).
LAMP_IRRADIANCE = 0.1

# How much brighter a pixel may be for one firefly, a thousand times as bright as all else in an even fill.
# Measured 9.4; without the limit 29.
FIREFLY = 12.0
# Light of a wall on the floor before it by rays in rounds, at a threshold of 0.8: its bias, relative
# (measured: -0.002; by all rays 0.001), and the share of the rays that is traced (measured: 0.30).
ADAPTIVE_BIAS = 0.01
ADAPTIVE_RAYS_LEFT = 0.5
# Rays of a pixel in the half of a frame where light is uneven, per ray of one in the even half, whose nearest
# pixels go by the other half's noise (measured: 2.7).
NOISY_HALF_RAYS = 2.0
# A constant picture after Cycles' denoiser, relative, away from the border, beyond which its network sees
# black (measured: 0.022; corner pixels are off by a third).
DENOISED_CONSTANT = 0.04
# Share of the noise of a picture of two samples that it leaves on a flat wall (measured: 0.1).
DENOISED_NOISE = 0.2
# How far it moves the mean of that picture, relative (measured: 0.006).
DENOISED_MEAN = 0.02
# Squared error that it leaves of a room's with one sample, against one of 64 (measured: 0.06).
DENOISED_ROOM = 0.25
# Light, openness and known share of 64 samples at one of 2 x 2 or 4 x 4 pixels against samples at all of
# them, of a floor before a wall of radiance 1, 192 x 144, mean and root mean square: shares of single pixels'
# rays are noise (measured: at most 0.004 and 0.024).
FEW_SAMPLES_MEAN = 0.01
FEW_SAMPLES_PIXEL = 0.04
# Mean light of six bounces in a room of 122 x 74 pixels, so sampled, relative: contacts between the samples
# are missed (measured: 0.003 and 0.009; all bounces but the first are a third of the light).
FEW_SAMPLES_BOUNCES = 0.02
# Number of a pixel's column read from samples of 4 x 4 pixels: each lies up to two beside its
# cell's middle (measured: 1.4).
UPSAMPLED_PLANE = 2.0
# Share of the squared error of two samples' direct light, and of what surfaces hand on, that the denoiser
# leaves in a closed room, and by how much it moves their means, relative (measured: 0.36 and 0.006).
DENOISED_LIGHT = 0.5
DENOISED_LIGHT_MEAN = 0.05
# An sRGB picture in 8 bits made linear in float32 and encoded again: far less than one of its steps
# (measured: 1e-4 of them).
EIGHT_BIT_STEPS = 0.01
# Mean light of a small render that was made twice, and sums of it in float32, relative (measured: 1e-6).
SAME_RENDER = 1e-4

# Resident memory after frame 200, or after the extension was switched on 50 times, against that after 20,
# relative: what counts as no growth. A run of 40 frames has grown by at most that, too.
MEMORY_GROWTH = 0.05
GROWTH_OF_A_SHORT_RUN = 0.05

# Single precision against double, of light and shares, relative to the pixel or to 1 % of the mean: the
# required bounds at the 99.9th percentile and at most, at pixels of whose rays none has moved.
FLOAT32_LIGHT = 1e-3
FLOAT32_LARGEST = 1e-2
# The same bounds where light is counted in sectors, and in steps of sevenths of them: rounding may count one
# more. Of 2 slices with 2 sides each one sector is a 128th of the hemisphere.
FLOAT32_SECTORS = {"horizon": (1e-3, 0.02), "bitmask": (1e-3, 0.05)}
# Share of the rays that meet something else in single precision, the required bound; and of those that meet
# another pixel, mostly the next one of the same surface.
FLOAT32_RAYS_CHANGED = 1e-3
FLOAT32_RAYS_MOVED = 1e-3
# Directions of a mirror that faces the camera: a few roundings of unit vectors.
FLOAT32_MIRROR_ANGLE = 1e-6
# Extent of a slab however thin: a few roundings.
FLOAT32_THIN_SLAB = 1e-6

# Mean light of the parts of a frame, by 64 rays, and of the frame turned over: root mean square over parts of
# 64 pixels, relative to the mean of all.
FLIPPED_MEAN = 0.02
# Mean light after the world was turned: directions of the sky are turned in single precision, and few rays
# go past another edge of a view.
TURNED_WORLD_MEAN = 1e-3
# Light of a crop beside a view of the whole, mean difference relative to the mean: patches at the border of
# the crop have other neighbours, and rays that leave it go on from the border.
CROPPED_FRAME = 0.02
# What twice the pixels each way leave of the error against eight times as many: a half, and what single
# edges and noise add.
HALF_THE_PIXELS_ERROR = 0.75
# Steps of light between columns at a border of the sampling pattern's tiles against all others, without a
# filter and with it: neighbours in a tile share a sequence, so that their noise is not independent (measured:
# at most 1.28 and 1.1).
TILE_BORDER = {False: 1.5, True: 1.25}

# Light away from rims, and the brightest pixel, of passes that are means over rims: relative. Rays meet the
# rims and bring the mixture of two surfaces.
AVERAGED_RIM_MEAN = 0.02
# Mean light where each pixel's surface is there a second time at the same depth.
COPLANAR_LAYER_MEAN = 0.01
# What wires of one pixel before a wall close of its hemispheres, per share of the frame that they are.
WIRE_SHARE = 2.0
# Widths of a blurred edge, upright and level, and at different scales: noise of 256 rays over 48 rows.
ROUND_BLUR = 0.05
SAME_BLUR_AT_ANY_DISTANCE = 0.02

# Bytes that each further pixel of a frame takes at the peak of the passes, beyond the frame itself: without
# views, and with a surround of half as many pixels. Small frames, whose pyramids are padded and whose rays at
# work count in part (measured: 278 and 350, and 403; of frames four times as large 227 and 280, and 330).
BYTES_PER_PIXEL = {"balanced": 320, "final": 400}
BYTES_PER_PIXEL_WITH_VIEWS = {"balanced": 450}

# Flicker of light that stays, or changes evenly, on planes that a camera slides along: what is left is
# reading smooth light between samples (measured at most 1.6e-3, two samples a frame), and float32.
FLICKER_OF_STEADY_LIGHT = 3e-3

# Flicker of known noise from some thousand places, relative: the mean of so many squares (0.01), and the
# share of the frame's brightness beside the local one (0.006).
FLICKER_OF_NOISE = 0.03

# The same while the camera moves: reading between four samples takes noise away, at most to
# sqrt((4 + 2 / 4) / 6) = 0.866 of it.
FLICKER_OF_NOISE_BETWEEN_SAMPLES = 0.866

# Flicker of light that is the same everywhere, relative: the share of the brightness beside the local one,
# half of a hundredth.
FLICKER_OF_EVEN_LIGHT = 0.006
