"""The places of equilibria and linear models that `make mutants` breaks."""

from mutant import Mutant

REST = (
    Mutant(
        "analysis/linear.rs",
        "let y = system.begin(&problem.motion);",
        "let y = system.begin(&Motion::typical_magnitudes(parameters));",
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
        "input.target_rate.map(|value| variable(value, driven))",
        "input.target_rate.map(|value| variable(value, false))",
        "linearize",
    ),
    Mutant(
        "analysis/balance.rs",
        "sigma[i] = thickness.mul_add(tilt[i], signed(i, geometry.contacts[i].a)) + q[D_T + i];",
        "sigma[i] = thickness.mul_add(tilt[i], geometry.contacts[i].a) + q[D_T + i];",
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
        "change.member = Member::From(change.scene.origin(&rest.z));",
        "",
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
