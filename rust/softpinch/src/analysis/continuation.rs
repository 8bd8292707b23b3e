//! Following an equilibrium while the scene changes, by continuation in the arc length.
//!
//! The rows depend on the unknowns z and on the share s of a change of the scene. The solutions form a curve (z, s).
//! A step goes along the curve's tangent, and Newton's method with a condition on the arc length returns to it. At a
//! fold the curve turns back in s: beyond it, no equilibrium continues this one.
//!
//! Steps must be so short that the search cannot jump to another branch. The tangents at both ends do not show a
//! jump, because they may be parallel on both branches. So Newton's method must end near the point that the tangent
//! predicts; and because a tip's force grows with the square of its compression, so that the compression is the length
//! on which the curve bends, a step must not change a compression by much of itself.

use nalgebra::{SMatrix, SVector};

use crate::analysis::rest::largest;
use crate::analysis::{Member, Rest, RestScene, UNKNOWNS, Unknowns};

const SIZE: usize = UNKNOWNS + 1;
type Vector = SVector<f64, SIZE>;
type Matrix = SMatrix<f64, SIZE, SIZE>;

/// First, longest and shortest step along the curve: 1 is a tip's radius, or 1 rad, or the whole change.
const FIRST: f64 = 0.02;
const LONGEST: f64 = 0.1;
const SHORTEST: f64 = 1e-9;
const STEPS: usize = 5_000;
const ITERATIONS: usize = 8;
/// The cosine of the largest turn of the tangent in a step.
const STRAIGHT: f64 = 0.98;
/// Largest distance from the predicted point, as a share of the step: that on an arc that turns as far as `STRAIGHT`.
const AWAY: f64 = 0.1;
/// Largest change of a compression in a step, as a share of the compression, or of the tip's radius if that is larger.
const COMPRESSED: f64 = 0.2;
const NEARLY_SEPARATED: f64 = 1e-3;
/// Change of the share for the derivatives by it, which steer the search; the solution does not depend on their error.
const DIFFERENCE: f64 = 1e-6;
/// Longest step in which an event is searched.
const CLOSE: f64 = 1e-4;
/// Most halvings of a step in the search for the instant of an event.
const BISECTIONS: usize = 60;

pub struct Point {
    pub share: f64,
    pub rest: Rest,
    /// Direction of the curve in the scale of the unknowns.
    tangent: Vector,
}

/// How a search along a curve ends.
pub enum End<E> {
    Reached(Rest),
    /// An event ends the search.
    Event(E, Point),
    /// The curve turns back: beyond this share no equilibrium continues it.
    Fold(Point),
    /// The search takes too many or too short steps.
    Lost(Point),
}

/// The rows at a point, and their linear system in the scales of unknowns and rows.
struct System {
    rest: Rest,
    balances: bool,
    /// The derivatives by unknowns and share; the last row is left free.
    matrix: Matrix,
    load: Vector,
    error: f64,
}

fn system(change: &impl Fn(f64) -> (RestScene, Member), z: &Unknowns, share: f64) -> System {
    let (scene, member) = change(share);
    let (unit, scale) = scene.scales();
    let rest = Rest { z: *z, rows: scene.rows(&member, z) };
    let beside = |share: f64| {
        let (scene, member) = change(share);
        scene.rows(&member, z).values
    };
    let (after, before) = (beside(share + DIFFERENCE), beside(share - DIFFERENCE));
    let matrix = Matrix::from_fn(|r, c| match (r < UNKNOWNS, c < UNKNOWNS) {
        (true, true) => rest.rows.jacobian[r][c] * unit[c] / scale[r],
        (true, false) => (after[r] - before[r]) / (2.0 * DIFFERENCE) / scale[r],
        _ => 0.0,
    });
    let load = Vector::from_fn(|r, _| if r < UNKNOWNS { -rest.rows.values[r] / scale[r] } else { 0.0 });
    let error = largest(&rest.rows.values, &scale);
    System { rest, balances: rest.balances(&scene), matrix, load, error }
}

/// The direction of the curve that has a positive share of `along`.
fn tangent(mut matrix: Matrix, along: &Vector) -> Option<Vector> {
    matrix.set_row(UNKNOWNS, &along.transpose());
    let direction = matrix.lu().solve(&Vector::from_fn(|r, _| f64::from(u8::from(r == UNKNOWNS))))?;
    let norm = direction.norm();
    (norm > 0.0 && norm.is_finite()).then(|| direction / norm)
}

impl Point {
    /// The start of a search at share zero; `None` if it does not balance, or the curve has no direction there.
    fn start(change: &impl Fn(f64) -> (RestScene, Member), rest: &Rest) -> Option<Self> {
        let System { rest, balances, matrix, .. } = system(change, &rest.z, 0.0);
        let forwards = Vector::from_fn(|r, _| f64::from(u8::from(r == UNKNOWNS)));
        let tangent = tangent(matrix, &forwards)?;
        balances.then_some(Self { share: 0.0, rest, tangent })
    }

    /// The point of the curve at a distance along the tangent. `None` if Newton's method does not return to the
    /// curve, or the step is too long.
    fn step(&self, change: &impl Fn(f64) -> (RestScene, Member), length: f64) -> Option<Self> {
        let found = self.corrected(change, length)?;
        let scene = change(self.share).0;
        let (unit, _) = scene.scales();
        let away = Vector::from_fn(|k, _| {
            let moved = if k < UNKNOWNS {
                (found.rest.z[k] - self.rest.z[k]) / unit[k]
            } else {
                found.share - self.share
            };
            moved - length * self.tangent[k]
        });
        let gentle = (0..2).all(|i| {
            let [before, after] = [self, &found].map(|point| point.rest.rows.balance.q.compression[i]);
            let least = NEARLY_SEPARATED * scene.parameters.tips[i].radius;
            (after - before).abs() <= (COMPRESSED * before.abs()).max(least)
        });
        (gentle && away.norm() <= AWAY * length && found.tangent.dot(&self.tangent) > STRAIGHT)
            .then_some(found)
    }

    /// The point to which Newton's method leads from the one at a distance along the tangent.
    fn corrected(&self, change: &impl Fn(f64) -> (RestScene, Member), length: f64) -> Option<Self> {
        let (unit, _) = change(self.share).0.scales();
        let predicted = |k: usize| self.rest.z[k] + length * self.tangent[k] * unit[k];
        let (mut z, mut share) =
            (std::array::from_fn(predicted), self.share + length * self.tangent[UNKNOWNS]);
        let mut before = f64::INFINITY;
        for _ in 0..ITERATIONS {
            let System { rest, balances, matrix, mut load, error } = system(change, &z, share);
            let mut bordered = matrix;
            bordered.set_row(UNKNOWNS, &self.tangent.transpose());
            let gone: f64 =
                (0..UNKNOWNS).map(|k| self.tangent[k] * (z[k] - self.rest.z[k]) / unit[k]).sum::<f64>()
                    + self.tangent[UNKNOWNS] * (share - self.share);
            load[UNKNOWNS] = length - gone;
            if balances && error >= 0.1 * before {
                // Iterations beyond this one only move round-off about.
                let tangent = tangent(matrix, &self.tangent)?;
                return Some(Self { share, rest, tangent });
            }
            if error > 2.0 * before || !error.is_finite() {
                return None;
            }
            before = error;
            let step = bordered.lu().solve(&load)?;
            for k in 0..UNKNOWNS {
                z[k] += step[k] * unit[k];
            }
            share += step[UNKNOWNS];
        }
        let System { rest, balances, matrix, .. } = system(change, &z, share);
        let tangent = tangent(matrix, &self.tangent)?;
        balances.then_some(Self { share, rest, tangent })
    }
}

/// Follows a curve from share zero. `change` has the scene and the member at each share of the change. `event` returns
/// the event that a point shows; `after_step` is told the end of each step, after which `change` may be another one.
/// `None` if the start does not balance, or the curve has no direction there.
pub fn follow<E>(
    change: impl Fn(f64) -> (RestScene, Member),
    start: &Rest,
    whole: f64,
    event: impl Fn(&RestScene, &Rest) -> Option<E>,
    after_step: impl Fn(&Rest),
) -> Option<End<E>> {
    let mut now = Point::start(&change, start)?;
    let mut length = FIRST;
    for _ in 0..STEPS {
        let Some(next) = now.step(&change, length) else {
            length *= 0.5;
            if length < SHORTEST {
                return Some(End::Lost(now));
            }
            continue;
        };
        let shows = |point: &Point| event(&change(point.share).0, &point.rest);
        let turned = |point: &Point| point.tangent[UNKNOWNS] <= 0.0;
        let ends = |point: &Point| turned(point) || shows(point).is_some();
        // An event may take eigenvalues, so it is asked for once.
        let ended = ends(&next);
        if next.share >= whole || ended {
            // The first event, or the end of the change, lies in this step. An event is approached by shorter
            // steps, because the points between may be on another branch.
            if ended && length > CLOSE {
                length *= 0.5;
                continue;
            }
            let (mut low, mut high, mut last) = (0.0, length, next);
            let mut jumps = false;
            for _ in 0..BISECTIONS {
                let middle = 0.5 * (low + high);
                if middle <= low || middle >= high {
                    break;
                }
                // Of very short steps, round-off decides how far they are from the predicted point.
                let found =
                    if high > CLOSE { now.step(&change, middle) } else { now.corrected(&change, middle) };
                let Some(point) = found else {
                    jumps = high > CLOSE;
                    break;
                };
                if point.share >= whole || ends(&point) {
                    (high, last) = (middle, point);
                } else {
                    low = middle;
                }
            }
            if jumps {
                length *= 0.5;
                continue;
            }
            if turned(&last) {
                return Some(End::Fold(last));
            }
            if let Some(found) = shows(&last) {
                return Some(End::Event(found, last));
            }
            let (scene, member) = change(whole);
            return Some(match Rest::solve(&scene, &member, &last.rest.z) {
                Some(rest) => End::Reached(rest),
                None => End::Lost(last),
            });
        }
        now = next;
        after_step(&now.rest);
        length = (1.5 * length).min(LONGEST);
    }
    Some(End::Lost(now))
}
