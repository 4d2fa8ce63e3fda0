//! Velocity networks: the paper's MLP and Hybrid with FiLM modulation, forward and backward, on the CPU.
//!
//! A [`Network`] is made from a [`NetworkShape`]. It gives velocities
//! ([`VelocityField`](crate::flow::VelocityField)), and the loss of a [`Batch`] with its gradient by the parameters, which
//! are one flat vector; [`NetworkShape::tensors`] names its parts.
//!
//! # Rooms
//!
//! From the ground up; each uses only those above it in this list.
//!
//! - `kernels`: the machinery. Vectorised loops, tiles and matrix products in either operand type ([`Precision`]), for the
//!   units that this [`Processor`] has. It knows no network.
//! - `parameters`: the table of tensors, their initial values, the errors of shapes.
//! - `layers`: the mathematics of layers on rows of features: dense, FiLM, GroupNorm, squeeze and excitation.
//! - `voxel`: clouds in grids: averages, interpolation, convolutions, the point-voxel block.
//! - `mlp`: the MLP: what is computed once per cloud, what at every point, loss and gradient.
//! - `hybrid`: the Hybrid: the context of a point, and an MLP as the head.
//!
//! `Network` stands on top. A file `x_bf16` is the bfloat16 twin of the layer `x` beside it.
//!
//! # MLP
//!
//! With flow time `t`, condition `c` and a point `x`, a position or a position and a colour,
//!
//! ```text
//! e  = SiLU(W_t phi(t) + b_t) + SiLU(W_c c + b_c)        phi: cosines and sines of t; c maybe through blocks
//! h  = W_x x + W_e e + b                                 input layer of [x | e]
//! m  = LN(h) (1 + gamma(e)) + beta(e)                    FiLM, gamma and beta affine in e
//! h' = m + W SiLU(m) + b                                 residual block, depth - 1 times
//! u  = W_o SiLU(h) + b_o
//! ```
//!
//! FiLM is of Perez et al. (AAAI 2018), LN is LayerNorm (Ba, Kiros and Hinton 2016), SiLU(x) = x / (1 + exp(-x)). All that
//! depends on `e` alone is computed once per cloud (the *conditioner*), the rest at every point, a tile of points at a time
//! (the *trunk*).
//!
//! # Operand types
//!
//! Weights, gradients, sums and norms are 32-bit floats. The operands of the products on points and voxels may be rounded to
//! bfloat16 ([`Precision`]), for processors that multiply such numbers faster: gradients then differ by some 0.2 % in the
//! MLP, and by as much or more in the Hybrid, where rounding may change which point has a maximum. Without a matrix unit, a
//! block's first convolution stays in floats: its few products are not worth rounding.
//!
//! # Hybrid
//!
//! The same layers act on `[x | C | e]`, with a context `C` of the cloud `X` about the point:
//!
//! ```text
//! C   = a(t) C_pv + (1 - a(t)) (W_g e + b_g)             a = sigmoid(k (t - tau))
//! f_1 = blocks(W_1 x + W_e e + b)                        from [x | e], at the first resolution
//! f_s = blocks(W_s f_(s-1) + b_s)                        two more stages
//! C_pv = W_o SiLU(GN(W_j [f_1 | f_2 | f_3 | max f_3] + b_j)) + b_o
//! ```
//!
//! A block acts on the features `h` of all points, on average in the voxels of a grid and at each point alone:
//!
//! ```text
//! g  = SiLU(GN(conv(SiLU(GN(conv(average of h per voxel))))))
//! v  = a(mean g) * interpolate(g) + SiLU(GN(W_p h + b_p))
//! h' = h + SiLU(GN(W_m v + b_m) (1 + gamma(e)) + beta(e))
//! ```
//!
//! These are [`ContextLayers::Residual`]: as in PVCNN (Liu et al., NeurIPS 2019) with GroupNorm (Wu and He, ECCV 2018) and SiLU for
//! its BatchNorm and ReLU:
//!
//! - The grid is the cube about the points' mean that holds the ball through the farthest point; coordinates are
//!   `r p` with `p` in `[0, 1]^3`, clamped to `r - 1`, rounded (ties to even) for averages, trilinear on the way back.
//! - Two convolutions of 3 x 3 x 3 with bias, padded by zeros. Squeeze and excitation `a` (Hu et al., CVPR 2018) with an eighth
//!   of the channels between, without biases, with ReLU and sigmoid.
//! - The shared projections are plain 1 x 1 convolutions; the shared MLP is one layer, its norm's output under FiLM.
//! - GroupNorm has 8 groups, or the largest of 4, 2, 1 that divides the channels; epsilon is 1e-5, as everywhere.
//! - The maximum is over the last stage's features. Joined features (`W_j`) are 128 by default.
//!
//! The authors' network, [`ContextLayers::Pvcnn`], has other layers on the same grids (BN: BatchNorm by its running statistics,
//! Ioffe and Szegedy, ICML 2015; L(x) = max(x, 0.1 x); `e'` an embedding of the context network's own):
//!
//! ```text
//! f_1 = blocks(ReLU(BN(W_1 x + W_e e' + b)))             f_s = blocks(ReLU(BN(W_s f_(s-1) + b_s)))
//! C_pv = W_o SiLU(GN(W_j [f_1 | f_2 | f_3 | MLP(max f_3)] + b_j)) + b_o
//!
//! g  = L(BN(conv(L(BN(conv(average of h per voxel))))))
//! v  = a(mean g) * interpolate(g) + ReLU(BN(W_p h + b_p))
//! p  = ReLU(BN(W_m v + b_m))
//! h' = p + GN(p) (1 + gamma(e')) + beta(e')
//! ```
//!
//! BN has an epsilon of 1e-4 in voxels and 1e-5 elsewhere; GN gcd(C, 32) groups; the cube is 1e-6 wider than the ball. It has
//! velocities and no gradient here: in training BN's moments are over all clouds of a batch, and here clouds run one after
//! another. `tdcr.torch` trains it; running statistics are tensors of its model file.
//!
//! A cloud's blocks of points and planes of voxels run in parallel, sums over them in fixed order.

mod hybrid;
mod kernels;
mod layers;
mod mlp;
mod network;
mod parameters;
mod voxel;

pub use crate::channels::Channels;
pub use hybrid::{ContextLayers, ContextShape, HybridShape, Stage, TimeGate};
pub use kernels::{Precision, Processor};
pub use mlp::{Batch, MlpShape, TimeFeatures};
pub use network::{Network, NetworkShape, Workspace};
pub use parameters::{InitialWeights, NetworkShapeError, TensorRole, TensorSpec};
