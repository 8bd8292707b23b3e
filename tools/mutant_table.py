"""The places of the core that `make mutants` breaks, and the tests that should notice."""

from dataclasses import dataclass

# In the place of a test's name: the core's own tests.
CARGO = "cargo test"


@dataclass(frozen=True)
class Mutant:
    """One change of one place, and the tests (pytest's -k) that should turn red."""

    file: str
    right: str
    wrong: str
    test: str


MUTANTS = (
    Mutant(
        "model/contact/law/inoue_hirai.rs",
        "tilt: area * (R::constant(2.0 / 3.0)",
        "tilt: R::constant(1.01) * area * (R::constant(2.0 / 3.0)",
        "energy",
    ),
    Mutant(
        "model/contact/law/inoue_hirai.rs",
        "normal: stiff_t.mul_add(",
        "normal: R::constant(1.01) * stiff_t.mul_add(",
        "energy",
    ),
    Mutant(
        "model/contact/law/inoue_hirai.rs",
        "tangential: stiff_n * d_n",
        "tangential: R::constant(1.01) * stiff_n * d_n",
        "energy",
    ),
    Mutant(
        "model/contact/law/inoue_hirai.rs",
        "normal: stiff_t.mul_add(",
        "normal: R::constant(1.000001) * stiff_t.mul_add(",
        "terms",
    ),
    Mutant("model/forces.rs", "normal + tangential,", "normal,", "energy"),
    Mutant(
        "model/forces.rs",
        "(self.torque[0] + self.finger_gravity[0])",
        "(self.torque[0] - self.finger_gravity[0])",
        "terms",
    ),
    Mutant("model/contact.rs", "swept = (u + signed", "swept = (u - signed", "terms"),
    Mutant(
        "model/contact.rs",
        "holonomic: (sx - thickness) - side.face.distance,",
        "holonomic: (sx - thickness) - side.face.distance * R::constant(1.0000001),",
        "terms",
    ),
    Mutant(
        "formulation/csm.rs",
        "two_alpha: R::constant(2.0 * alpha)",
        "two_alpha: R::constant(1.9 * alpha)",
        "stabilization",
    ),
    Mutant(
        "formulation/csm.rs",
        "beta: R::constant(beta)",
        "beta: R::constant(1.01 * beta)",
        "stabilization",
    ),
    Mutant("formulation/equations.rs", "half.mul_add(change, p)", "change + p", "energy"),
    Mutant("method/rk4.rs", "R::constant(1.0 / 3.0) * h", "R::constant(0.3334) * h", "convergence"),
    Mutant("method/rk4.rs", "drive.at(tau + half)", "drive.at(tau)", "convergence"),
    Mutant(
        "formulation/constrained.rs",
        "mixed = -(h * (k * inverse));",
        "mixed = h * k * inverse;",
        "terms or trajectories",
    ),
    Mutant(
        "formulation/projected.rs",
        "q = if R::ORDER > 0 { R::outlined(step) } else { step.run() };",
        "let _ = (step, &mut q);",
        "formulations",
    ),
    Mutant("method/dop853/tableau.rs", "0.2413651341592667", "0.2413651441592667", CARGO),
    Mutant(
        "stepping/grid.rs",
        "inputs.next_breakpoint(from)",
        "inputs.next_breakpoint(self.end)",
        "convergence",
    ),
    Mutant(
        "model/piecewise.rs",
        "Some(&origin) if origin != anchor",
        "Some(&origin) if origin > anchor",
        "trajectories",
    ),
    Mutant("model/control.rs", "self.ki.neg_mul_add(memory", "self.ki.mul_add(memory", "terms"),
    Mutant(
        "number/linear.rs",
        "let x2 = y2 / d2;",
        "let x2 = y2 / d2 * R::constant(1.0000001);",
        "terms",
    ),
    Mutant("number/trigonometry.rs", "8.333_333_333_322_49e-3", "8.333_333_334_322_49e-3", CARGO),
    Mutant(
        "number/trigonometry.rs",
        "z.mul_add(r, -(x * y)))",
        "z.mul_add(r, -(x * y)) + c(1e-15) * z)",
        CARGO,
    ),
    Mutant(
        "number/trigonometry.rs",
        "x - (z * x).neg_mul_add(in_pairs(&S, z), R::zero())",
        "(z * x).mul_add(in_pairs(&S, z), x)",
        CARGO,
    ),
    Mutant(
        "stepping/instant.rs",
        "{ finite } else { each_finite(now, closure) }",
        "{ finite } else { finite }",
        CARGO,
    ),
    Mutant(
        "number/trigonometry.rs", "const SMALL: f64 = 0.785;", "const SMALL: f64 = 0.786;", CARGO
    ),
    Mutant(
        "stepping/monitor.rs",
        "violation(Violation::Pulling, bilateral, along, R::zero(), false);",
        "violation(Violation::Pulling, bilateral, along + R::constant(1e9), R::zero(), false);",
        "extreme",
    ),
    Mutant(
        "stepping/record.rs",
        "put(Column::Q, &q.row());",
        "put(Column::Q, &p.row());",
        "recording or symmetry",
    ),
    Mutant(
        "model/contact/law/relaxation.rs",
        "found.rates[zeta] = shear * rate;",
        "found.rates[zeta] = stretched * share;",
        "relaxation",
    ),
    Mutant(
        "method/linearize.rs",
        "load = load.plus(rows[n][m], x[m]);",
        "load = load.plus(rows[n][m], x[n]);",
        "relaxation",
    ),
    Mutant(
        "stepping/equal_lanes.rs",
        "let struck = first == 0 && scene",
        "let struck = first == 0 && start > scene.initial.time && scene",
        "impulse",
    ),
    Mutant(
        "number/dual.rs",
        "(self.chain(sin, cos), self.chain(cos, -sin))",
        "(self.chain(sin, cos), self.chain(cos, sin))",
        CARGO,
    ),
    Mutant("formulation/tangent.rs", "states.wrapping_sub(first)", "W", CARGO),
    Mutant(
        "method/linearize.rs",
        "delayed[i][k] = rate[r].mul_add(rows[r][k], delayed[i][k]);",
        "",
        CARGO,
    ),
    Mutant("number/linear.rs", "column.swap(k, *exchanged);", "", CARGO),
    Mutant(
        "method/newton.rs",
        "const FIXED: f64 = 1e-17;",
        "const FIXED: f64 = 1e-6;",
        "convergence",
    ),
    Mutant(
        "method/newton.rs",
        "self.reusable = rate <= REUSE_RATE;",
        "self.reusable = false;",
        "methods",
    ),
    Mutant(
        "method/implicit_midpoint.rs",
        "next[n] = 2.0f64.mul_add(z[n], step.y[n]);",
        "next[n] = 2.000001f64.mul_add(z[n], step.y[n]);",
        "convergence",
    ),
    # Runs after the first one in a loop would have its Jacobian.
    Mutant(
        "method/newton.rs",
        "(method.tangent, method.magnitudes) = (runs.tangent(), magnitudes(runs, &runs.system()));",
        "let _ = (method, runs);",
        CARGO,
    ),
    Mutant("method/radau5.rs", "0.250_213_122_965_333_3", "0.250_213_123_965_333_3", CARGO),
    Mutant(
        "method/radau5.rs",
        "z[n] = step.h * works[n];",
        "z[n] = 1.01 * step.h * works[n];",
        "convergence",
    ),
    Mutant("method/rosenbrock.rs", "-0.189532918363016", "-0.189532928363016", CARGO),
    Mutant(
        "method/rosenbrock.rs",
        "E::of(share.mul_add(linearization.jacobian.rows[n][by_time], load[n]))",
        "E::of(load[n])",
        "convergence",
    ),
    Mutant(
        "method/dop853.rs",
        "R::constant(2.0).mul_add(change, -h * (last[n] + first[n]))",
        "R::constant(2.0).mul_add(change, -h * last[n])",
        CARGO,
    ),
    Mutant(
        "method/step_control.rs",
        "let allowed = errors.at_most(c(1.0));",
        "let allowed = errors.at_most(c(1e3));",
        CARGO,
    ),
    Mutant(
        "stepping/adaptive_lanes.rs",
        "system.correct(&lanes.batch.drive, since, &mut between);",
        "",
        "methods",
    ),
    Mutant(
        "stepping/sizes.rs",
        "self.largest[n] = R::select(larger, y[n].abs(), self.largest[n]);",
        "",
        "methods",
    ),
    Mutant(
        "stepping/equal_lanes.rs",
        "(self.in_use, self.taken_at) = (Some(point), Some(point));",
        "(self.in_use, self.taken_at) = (Some(point), Some([f64::NAN; 21]));",
        "recording",
    ),
    Mutant(
        "stepping/grid.rs", "first: step, start: time", "first: step + 1, start: time", "recording"
    ),
    Mutant(
        "model/noise.rs",
        "0x9E37_79B9_7F4A_7C15",
        "0x9E37_79B9_7F4A_7C17",
        CARGO,
    ),
    Mutant(
        "model/noise.rs",
        "(radius * cos, radius * sin)",
        "(radius * cos, radius * cos)",
        "noise",
    ),
    Mutant(
        "model/noise.rs",
        "if self.start <= t && t < self.end {",
        "if self.start <= t {",
        "noise",
    ),
    Mutant(
        "model/drive.rs",
        "wave.active &= !(1 << lane);",
        "",
        "ensemble",
    ),
    Mutant(
        "model/drive.rs",
        "self.degree = self.degrees.into_iter().max().unwrap_or(0);",
        "self.degree = own.degree;",
        "ensemble",
    ),
    Mutant(
        "stepping/summary.rs",
        ".min_in(left, seen)",
        "",
        "ensemble",
    ),
    Mutant(
        "stepping/summary.rs",
        "let seen = seen & self.after.at_most(instant.t);",
        "let seen = seen & self.after.less(instant.t);",
        "ensemble",
    ),
    Mutant(
        "number/linear.rs",
        "*earlier &= !larger;",
        "",
        CARGO,
    ),
    Mutant(
        "stepping/equal_lanes.rs",
        "self.batch.active() & !(self.batch.phases.at(Phase::Struck) | self.held)",
        "self.batch.active() & !self.held",
        "ensemble",
    ),
    Mutant(
        "stepping/equal_lanes.rs",
        "run.place.arrival += 1;",
        "",
        "impulse",
    ),
    Mutant(
        "stepping/adaptive.rs",
        "let watching = accepted & !entering;",
        "let watching = accepted;",
        "ensemble",
    ),
    Mutant(
        "stepping/adaptive.rs",
        "start.sizes.note(size, arrived, accepted, 0);",
        "start.sizes.note(size, arrived, R::ALL, 0);",
        "ensemble",
    ),
    Mutant(
        "method/step_control.rs",
        "z.mul_add(c(1.0 / 9.0), c(1.0 / 7.0))",
        "z.mul_add(c(1.0 / 9.0), c(1.0 / 6.0))",
        CARGO,
    ),
    Mutant("method/table.rs", "|| rate.re > 0.0 {", "{", CARGO),
    Mutant("method/table.rs", "growth > 1.0 + 2.0 * ROUND_OFF", "growth > 1.1", CARGO),
    Mutant("stepping/grid.rs", "h: self.h / f64::from(refine)", "h: self.h", CARGO),
    Mutant(
        "stepping/adaptive.rs",
        "most.at_most(lanes.progress.attempts)",
        "most.at_most(lanes.progress.steps)",
        "max_steps",
    ),
    Mutant(
        "stepping/adaptive.rs",
        "most.at_most(lanes.progress.attempts)",
        "most.less(lanes.progress.attempts)",
        "max_steps",
    ),
    Mutant(
        "formulation/constrained.rs",
        "whole[k] = b[k] + share[k];",
        "whole[k] = b[k];",
        "driven",
    ),
    Mutant(
        "formulation/equations.rs",
        "works[work::CONTROL] = works[work::CONTROL] + driving;",
        "let _ = driving;",
        "driven",
    ),
    Mutant(
        "model/forces.rs",
        "self.masses.finger[0].mul_add(acceleration[0], -others[0])",
        "-others[0]",
        "driven",
    ),
    Mutant("model/drive.rs", "[value, first, second + second]", "[value, first, second]", "driven"),
    Mutant(
        "model/piecewise.rs",
        "SMOOTH * (size + other.abs())",
        "1e9 * (size + other.abs())",
        "driven",
    ),
    Mutant("model/start.rs", "off > CONSISTENCY * size", "off > 1e9 * size", "driven"),
    Mutant(
        "model/motion.rs",
        "parameters.control[i].ki == 0.0 {",
        "parameters.control[i].ki < 0.0 {",
        "leaving_out",
    ),
    Mutant("tests/operations.rs", "(size.degrees, size.all(),", "(size.states, size.all(),", CARGO),
    Mutant(
        "formulation/contact_solve.rs",
        "let sliding = load.friction[i] * along;",
        "let sliding = R::constant(1.01) * (load.friction[i] * along);",
        "contact_invariants",
    ),
    Mutant(
        "formulation/contact_solve.rs",
        "share[i] = R::select(graze, along,",
        "share[i] = R::select(graze, one,",
        "contact_invariants or contact_agreement",
    ),
    Mutant(
        "formulation/impact.rs",
        "impulses[k] * 0.5 * (before[k] + after[k])",
        "impulses[k] * before[k]",
        "contact_invariants",
    ),
    Mutant(
        "formulation/impact.rs",
        "Mode::Stick => short(friction * along - across.abs(), size)",
        "Mode::Stick => short(along, size)",
        "contact_agreement",
    ),
    Mutant(
        "formulation/unilateral.rs",
        "let loss = -(response.multipliers[2 + i] * drift[2 + i]);",
        "let loss = response.multipliers[2 + i] * drift[2 + i];",
        "contact_invariants",
    ),
    Mutant(
        "formulation/unilateral.rs",
        "R::select(free, frozen.normal, live.normal)",
        "live.normal",
        "contact_invariants or contact_agreement",
    ),
    Mutant(
        "formulation/mode_selection.rs",
        "vec![Mode::Stick, Mode::Slip(Slip::Up), Mode::Slip(Slip::Down)]",
        "vec![Mode::Stick, Mode::Slip(Slip::Up)]",
        "contact_agreement",
    ),
    Mutant(
        "stepping/event_search.rs",
        "length < least",
        "length > least",
        "contact_agreement",
    ),
    Mutant(
        "stepping/contact_lane.rs",
        "self.free_time += if free {",
        "self.free_time += if !free {",
        "unilateral_study",
    ),
    # Controllers and simulators.
    Mutant(
        "model/controller_state.rs",
        "controller.applied(self.origin, self.acted) <= t",
        "controller.applied(self.origin, self.acted) < t",
        "test_sampled",
    ),
    Mutant(
        "model/controller_state.rs",
        "(next[k] - xi[k]) * (wanted[i] - limited[i]) > 0.0",
        "(next[k] - xi[k]) * (wanted[i] - limited[i]) < 0.0",
        "test_sampled",
    ),
    Mutant(
        "model/controller_state.rs",
        "y[k] = (y[k] / controller.resolution[k]).round()",
        "y[k] = (y[k] / controller.resolution[k]).floor()",
        "test_sampled",
    ),
    Mutant("model/sampled.rs", "|| value < below", "|| value < above", "test_cascade"),
    Mutant("model/sampled.rs", "+ SAME * self.period >= *at", ">= *at", "test_cascade"),
    Mutant("model/sampled.rs", "*latched && *second", "*second", "test_cascade"),
    Mutant(
        "model/sampled.rs",
        "first = first.min(block.first_after(origin, acts.0, t));",
        "let _ = (acts, &mut first);",
        "test_sampled",
    ),
    Mutant(
        "stepping/lane_controller.rs",
        "let earlier = watched.t < self.changed || watched.before_sample;",
        "let earlier = watched.before_sample;",
        "test_sampled",
    ),
    Mutant(
        "model/sampled.rs",
        "if near >= first && (t - near).abs() <= SAME * period { near } else { t }",
        "t",
        "test_cascade",
    ),
    Mutant(
        "model/controller_state.rs",
        "let before = own(number - 1);",
        "let before = own(number);",
        "test_cascade",
    ),
    Mutant(
        "stepping/lane_controller.rs",
        "zip(&self.blocks).rev() {",
        "zip(&self.blocks) {",
        "test_cascade",
    ),
    Mutant(
        "stepping/equal_lanes.rs",
        "run.place.sampled = Some(self.clock);",
        "",
        "test_sampled",
    ),
    Mutant(
        "stepping/adaptive_events.rs",
        "let now = start.system.evaluate(&self.batch.drive, self.progress.tau, &start.y);",
        "let now = start.now;",
        "test_sampled",
    ),
    Mutant(
        "driver/simulator.rs",
        "let next = periods * period + self.origin;",
        "let next = self.observed.t + period;",
        "test_simulator",
    ),
    Mutant(
        "driver/simulator.rs",
        "let goes_on = status == Status::Completed && until < self.span.end;",
        "let goes_on = status == Status::Completed;",
        "test_simulator",
    ),
    Mutant(
        "driver/simulator.rs",
        "*grid = (state.time, 0);",
        "let _ = grid;",
        "test_simulator",
    ),
    Mutant(
        "stepping/recorder.rs",
        "let records = !matches!(self.due, Due::Never);",
        "let records = true;",
        CARGO,
    ),
    # Equilibria and linear models.
    Mutant(
        "analysis/linear.rs",
        "(system.begin(&self.motion), ",
        "(system.begin(&Motion::typical_magnitudes(self.runs.parameters[0])), ",
        "stability",
    ),
    Mutant(
        "analysis/linear.rs",
        "problem.drive.hold(now.torque);",
        "problem.drive.hold([0.0; 2]);",
        "linearize",
    ),
    Mutant(
        "analysis/linear.rs",
        "input.target_rate.map(|value| number(value, driven))",
        "input.target_rate.map(|value| number(value, false))",
        "linearize",
    ),
    Mutant(
        "analysis/balance.rs",
        "thickness.mul_add(tilt[i], signed(i, geometry.contacts[i].place)) + q.shear[i];",
        "thickness.mul_add(tilt[i], geometry.contacts[i].place) + q.shear[i];",
        "test_equilibrium",
    ),
    Mutant(
        "analysis/balance.rs",
        "mean.mul_add(change, state.sigma[i] - R::constant(from.sigma[i]))",
        "state.sigma[i] - R::constant(from.sigma[i])",
        "test_wrench or test_settled",
    ),
    Mutant(
        "analysis/balance.rs",
        "left_over[FINGER + i] = left_over[FINGER + i] - forces.torque[i];",
        "",
        "test_equilibrium",
    ),
    Mutant(
        "analysis/rest.rs",
        "-(forces[r][c] + (forces[r][5] * no_slip[0][c] + forces[r][6] * no_slip[1][c]))",
        "-forces[r][c]",
        "test_plot or test_mode_shapes or stiffness",
    ),
    Mutant(
        "analysis/rest.rs",
        "const ROUND_OFF: f64 = 1e-11;",
        "const ROUND_OFF: f64 = 1e-4;",
        "just_beyond",
    ),
    Mutant(
        "analysis/equilibrium.rs",
        "if r == 5 + k { -1.0 / scale[r] }",
        "if r == 5 + k { 1.0 / scale[r] }",
        "test_equilibrium",
    ),
    Mutant(
        "analysis/wrench.rs",
        "|rest: &Rest| member.set(Member::From(scene.origin(&rest.z)))",
        "|_: &Rest| ()",
        "test_wrench",
    ),
    Mutant(
        "analysis/continuation.rs",
        "const STRAIGHT: f64 = 0.98;",
        "const STRAIGHT: f64 = -2.0;",
        "test_equilibrium_map",
    ),
    Mutant(
        "analysis/continuation.rs",
        "let turned = |point: &Point| point.tangent[UNKNOWNS] <= 0.0;",
        "let turned = |_: &Point| false;",
        "test_equilibrium_map or test_wrench",
    ),
)
