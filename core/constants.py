"""Numbers that forward and backward passes must share, each with its reason.

Everything here is read by the torch reference and compiled into the numba kernels; the cache of
compiled code is keyed by this file (see `core.compiled`), so a change takes effect at once.
"""

from __future__ import annotations

# --- rasterizer ---------------------------------------------------------------------------------

#: Gaussians whose centre lies nearer than this share of the scene's depth unit are culled:
#: the perspective Jacobian grows as 1/z^2 and a splat that close covers the whole frame.
NEAR_PLANE = 0.01

#: The perspective Jacobian is evaluated at a direction clamped to the frame plus this share of its
#: size on every side: beyond it the affine approximation explodes for splats beside the camera
#: (gsplat's convention). The clamped branch has no gradient.
FRUSTUM_MARGIN = 0.15

#: Variance (px^2) added to both axes of the projected covariance: a splat is never thinner than
#: a pixel's own footprint, which keeps the inverse bounded and the image free of aliasing holes.
LOW_PASS_VARIANCE = 0.3

#: An evaluation with less opacity than one 8-bit step changes no displayed pixel; it also bounds
#: the ellipse that is tested against tiles.
ALPHA_MINIMUM = 1.0 / 255.0

#: Opacity is capped here so that 1 / (1 - alpha) stays bounded in the gradient (<= 100). Forward
#: and backward use this one constant: a mismatch corrupts the recovered transmittance.
ALPHA_MAXIMUM = 0.99

#: A pixel takes no more Gaussians once its transmittance has fallen below this share: what lies
#: behind adds less than a fortieth of an 8-bit step. The Gaussian that crosses it still counts.
TRANSMITTANCE_STOP = 1.0e-4

#: Width of a tile in pixels: one row of 16 float32 fills one 512-bit register.
TILE = 16

#: Height of a tile on the CPU (at most 128: blending keeps a row in a byte). Taller tiles mean fewer (Gaussian, tile)
#: pairs, each of which has a cost of its own; shorter ones stop earlier where they are opaque. Against 32 rows, 64
#: took 7 % off an iteration on the benchmark's scene and added 10 % to blending where nearly everything is opaque.
TILE_ROWS = 64

#: Scales are clamped to exp(+-this) before use: exp(40) = 2e17 squares inside float32's range.
LOG_SCALE_LIMIT = 40.0

#: Quaternions shorter than this have no direction; the splat is culled and counted.
QUATERNION_MINIMUM_NORM = 1.0e-12

#: Gaussians farther than this (scene units) are culled: what is shown there is sky, and their depth times a gradient
#: of a frame's pixels leaves float32.
FAR_PLANE = 1.0e12

#: Gaussians whose harmonics are longer (root of the sum of squares; white is 1.8) are culled: a colour times
#: the steepest slopes of a giant or a needle stays inside float32 below it. HDR values of 1e4 are far inside.
HARMONICS_LIMIT = 1.0e6

#: Determinants of a projected covariance below this cannot be inverted in float32. With the
#: low-pass the determinant is at least LOW_PASS_VARIANCE**2 in exact arithmetic.
DETERMINANT_MINIMUM = 1.0e-10

#: Zeroth-order real spherical harmonic: colour = SH_C0 * sh[0] + 0.5, the 3DGS convention.
SH_C0 = 0.28209479177387814
SH_C1 = 0.4886025119029199
SH_C2 = (1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396)
SH_C3 = (
    -0.5900435899266435,
    2.890611442640554,
    -0.4570457994644658,
    0.3731763325901154,
    -0.4570457994644658,
    1.445305721320277,
    -0.5900435899266435,
)
#: Number of coefficients per colour channel at each degree.
SH_COEFFICIENTS = (1, 4, 9, 16)
