//! The solve of (24) with contacts in any mode.
//!
//! M a = f + K u and R a = -b, where K and R depend on the modes:
//!
//! | mode | columns of K | rows |
//! |---|---|---|
//! | stick | h_i for lambda^H, n_i for lambda^N | h_i a = -b^H, n_i a = -b^N |
//! | slip | h_i for lambda^H, n_i for lambda^N | h_i a = -b^H, lambda^N + sigma mu lambda^H = 0 |
//! | graze | c_i for psi, n_i for lambda^N | h_i a = -b^H, lambda^N = 0 |
//! | free | h_i for lambda^H, n_i for lambda^N | lambda^H = 0, lambda^N = 0 |
//!
//! h_i and n_i are the rows of Phi, c_i is the generalised force of a tip's couple. Eliminating a leaves a
//! 4 x 4 system for u. It is solved by LU without pivots, the finger that grazes last: as long as friction is
//! below the critical coefficient, the leading minors are positive. It is not symmetric. It is
//! singular if both tips graze and neither finger turns its tip; such a pair of modes is never chosen.

use crate::model::{Contacts, Coordinates, Geometry, Parts, Plant, each_coordinate};
use crate::number::{LaneTask, Real, signed, task};

/// Forces, couples and friction at one state.
#[derive(Debug, Clone, Copy)]
pub struct Load<R> {
    /// The generalised force f without multipliers and without the couples of tips that graze or are free.
    pub force: Coordinates<R>,
    /// dP/d theta_pi of both tips, N m.
    pub couple: [R; 2],
    pub friction: [R; 2],
    /// The bias b of the rows, in the order of the multipliers.
    pub bias: [R; 4],
    pub finger_acceleration: [R; 2],
}

#[derive(Debug, Clone, Copy)]
pub struct Response<R> {
    /// (lambda_1^H, lambda_2^H, lambda_1^N, lambda_2^N).
    pub multipliers: [R; 4],
    /// The part psi of the couple that acts: 1 in stick and slip, 0 in free.
    pub share: [R; 2],
    pub acceleration: Coordinates<R>,
    /// The pivots of R M^-1 K, one while both tips stick. Their product is its determinant; solutions with a negative one are
    /// unstable.
    pub pivots: [R; 4],
}

impl Response<f64> {
    /// The acceleration that the whole couple of finger `i`, which grazes, gives to its gap: a pivot of the solve, in which
    /// a finger that grazes comes last.
    pub(crate) fn couple_effect(&self, i: usize, graze: [bool; 2]) -> f64 {
        self.pivots[if graze == [true; 2] { 2 * i } else { 2 }].abs()
    }
}

impl<R: Real> Response<R> {
    /// `with` in the lanes of `bits`, this one in all other lanes.
    #[inline(always)]
    pub(super) fn replaced(mut self, bits: u8, with: &Self) -> Self {
        for k in 0..4 {
            self.multipliers[k] = R::select(bits, with.multipliers[k], self.multipliers[k]);
            self.pivots[k] = R::select(bits, with.pivots[k], self.pivots[k]);
        }
        for k in 0..2 {
            self.share[k] = R::select(bits, with.share[k], self.share[k]);
        }
        self.acceleration = Coordinates::select(bits, &with.acceleration, &self.acceleration);
        self
    }
}

/// Two rows (H, N) of the system with the columns of one finger.
type Block<R> = [[R; 2]; 2];

#[inline(always)]
fn select_block<R: Real>(bits: u8, a: &Block<R>, b: &Block<R>) -> Block<R> {
    let mut block = *b;
    for r in 0..2 {
        for c in 0..2 {
            block[r][c] = R::select(bits, a[r][c], b[r][c]);
        }
    }
    block
}

/// Multipliers, shares of the couples and accelerations.
#[inline(always)]
pub fn response<R: Real, P: Parts>(
    driven: bool,
    geometry: &Geometry<R, P>,
    plant: &Plant<R>,
    contacts: &Contacts<R>,
    load: &Load<R>,
) -> Response<R> {
    let solve = Solve { driven, geometry, plant, contacts, load };
    // Only the steps of the paper's parts have it inlined.
    if const { P::PAPERS && R::ORDER == 0 } { solve.run() } else { R::outlined(solve) }
}

task! {
    ['a, R: Real, P: Parts]
    Solve<'a, R, P>(driven: bool, geometry: &'a Geometry<R, P>, plant: &'a Plant<R>, contacts: &'a Contacts<R>,
        load: &'a Load<R>)
    for R => Response<R> = {
        let (force, w) = (&load.force, &plant.inverse_masses);
        let (zero, one) = (R::zero(), R::constant(1.0));
        let mut unforced = each_coordinate!([force, w] => force * w);
        if driven {
            unforced.finger = load.finger_acceleration;
        }
        let [h1, h2, n1, n2] = geometry.phi_times(&unforced);
        let swept = [[h1, n1], [h2, n2]];
        // Rows of finger i, columns of finger j.
        let mut blocks = [[[[zero; 2]; 2]; 2]; 2];
        let mut right = [[zero; 2]; 2];
        for i in 0..2 {
            let (free, graze, slip) = (contacts.free[i], contacts.graze[i], contacts.slip(i));
            for j in 0..2 {
                let mut block = own_block(geometry, w, (i, j), contacts.graze[j], load.couple[j]);
                let (unit, friction) = if i == j {
                    (one, R::select(contacts.down[i], -load.friction[i], load.friction[i]))
                } else {
                    (zero, zero)
                };
                // The row H of a free tip, and the rows N of all tips that do not stick.
                block[0][0] = R::select(free, unit, block[0][0]);
                block[0][1] = R::select(free, zero, block[0][1]);
                block[1][0] = R::select(slip, friction, R::select(free | graze, zero, block[1][0]));
                block[1][1] = R::select(slip | free | graze, unit, block[1][1]);
                blocks[i][j] = block;
            }
            right[i][0] = R::select(free, zero, -(load.bias[i] + swept[i][0]));
            right[i][1] = R::select(slip | free | graze, zero, -(load.bias[2 + i] + swept[i][1]));
        }
        let swapped = contacts.graze[0] & !contacts.graze[1];
        let (first, second, pivots) = solve(&blocks, &right, swapped);
        let unknowns = [
            [R::select(swapped, second[0], first[0]), R::select(swapped, second[1], first[1])],
            [R::select(swapped, first[0], second[0]), R::select(swapped, first[1], second[1])],
        ];
        let (mut multipliers, mut share) = ([zero; 4], [one; 2]);
        for i in 0..2 {
            let (graze, slip, unloaded) = (contacts.graze[i], contacts.slip(i), contacts.unloaded(i));
            let [along, solved] = unknowns[i];
            // Friction is mu lambda^H to the bit, not up to the solve's round-off.
            let sliding = load.friction[i] * along;
            let sliding = R::select(contacts.down[i], sliding, -sliding);
            let across = R::select(slip, sliding, solved);
            multipliers[i] = R::select(unloaded, zero, along);
            multipliers[2 + i] = R::select(unloaded, zero, across);
            share[i] = R::select(graze, along, R::select(contacts.free[i], zero, one));
        }
        let mut total = geometry.phi_transposed_times(&multipliers);
        let mut parts = [zero; 2];
        for i in 0..2 {
            let part = R::select(contacts.graze[i], -(load.couple[i] * share[i]), zero);
            parts[i] = -part;
            if geometry.is_the_papers() {
                total.object[2] = total.object[2] + signed(i, part);
                total.finger[i] = total.finger[i] + part;
            }
        }
        if !geometry.is_the_papers() {
            let (object, finger) = geometry.couples(parts);
            for k in 0..3 {
                total.object[k] = total.object[k] + object[k];
            }
            total.finger = [total.finger[0] + finger[0], total.finger[1] + finger[1]];
        }
        let acceleration = each_coordinate!([total, w, unforced] => total.mul_add(w, unforced));
        Response { multipliers, share, acceleration, pivots }
    }
}

/// The rows h_i and n_i times M^-1, times the columns h_j (or c_j where finger j grazes) and n_j.
#[inline(always)]
fn own_block<R: Real>(
    geometry: &Geometry<R, impl Parts>,
    w: &Coordinates<R>,
    (i, j): (usize, usize),
    graze: u8,
    couple: R,
) -> Block<R> {
    let (own, other) = (&geometry.contacts[i], &geometry.contacts[j]);
    let [w_x, _, w_theta] = w.object;
    let (a, e) = (own.a * w_theta, own.e * w_theta);
    let same = i == j;
    let along = if same { w_x } else { -w_x };
    let mut block = [[a.mul_add(other.a, along), a * other.e], [e * other.a, e.mul_add(other.e, w_x)]];
    if !same && !geometry.is_the_papers() {
        let (one, zero) = (R::constant(1.0), R::zero());
        for (r, unit) in [[one, zero], [zero, one]].into_iter().enumerate() {
            let [along, across] = own.push(i, unit);
            let ([h, k], [m, n]) = (other.push(j, [one, zero]), other.push(j, [zero, one]));
            let turn = [a, e][r];
            block[r] = [
                turn.mul_add(other.a, w_x * along.dot2(h, across, k)),
                turn.mul_add(other.e, w_x * along.dot2(m, across, n)),
            ];
        }
    }
    let ([x, y], turned, finger) = other.tilt_by(j);
    let mut by_couple = [a * turned, e * turned];
    if !geometry.is_the_papers() {
        let [along, across] = own.in_side_axes([x, y]);
        by_couple = [w_x.mul_add(signed(i, along), by_couple[0]), w_x.mul_add(across, by_couple[1])];
    }
    if same {
        let (b, f) = (own.b * w.finger[i], own.f * w.finger[i]);
        block[0][0] = block[0][0] + b.mul_add(own.b, w.compression[i]);
        block[0][1] = b.mul_add(own.f, block[0][1]);
        block[1][0] = f.mul_add(own.b, block[1][0]);
        block[1][1] = block[1][1] + f.mul_add(own.f, w.shear[i]);
        by_couple = [b.mul_add(finger, by_couple[0]), f.mul_add(finger, by_couple[1])];
    }
    for r in 0..2 {
        block[r][0] = R::select(graze, -(couple * by_couple[r]), block[r][0]);
    }
    block
}

/// Solves the system. In the lanes of `swapped` the second finger comes first. Returns the unknowns of the
/// finger that comes first, those of the other one, and the pivots.
#[inline(always)]
fn solve<R: Real>(blocks: &[[Block<R>; 2]; 2], right: &[[R; 2]; 2], swapped: u8) -> ([R; 2], [R; 2], [R; 4]) {
    let one = R::constant(1.0);
    let [[a, b], [c, d]] = blocks;
    let (p, q) = (select_block(swapped, d, a), select_block(swapped, c, b));
    let (r, s) = (select_block(swapped, b, c), select_block(swapped, a, d));
    let mut rows = [[one; 5]; 4];
    for (k, (left, other, i)) in [(p, q, 0), (r, s, 1)].into_iter().enumerate() {
        for n in 0..2 {
            rows[2 * k + n] = [
                left[n][0],
                left[n][1],
                other[n][0],
                other[n][1],
                R::select(swapped, right[1 - i][n], right[i][n]),
            ];
        }
    }
    for k in 0..4 {
        let inverse = one / rows[k][k];
        for n in k + 1..4 {
            let factor = rows[n][k] * inverse;
            for c in k + 1..5 {
                rows[n][c] = factor.neg_mul_add(rows[k][c], rows[n][c]);
            }
        }
    }
    let mut x = [one; 4];
    for k in (0..4).rev() {
        let mut sum = rows[k][4];
        for c in k + 1..4 {
            sum = rows[k][c].neg_mul_add(x[c], sum);
        }
        x[k] = sum / rows[k][k];
    }
    ([x[0], x[1]], [x[2], x[3]], [rows[0][0], rows[1][1], rows[2][2], rows[3][3]])
}
