"""The places of controllers and simulators that `make mutants` breaks."""

from mutant import CARGO, Mutant

CONTROL = (
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
        "model/measures.rs",
        "y[k] = (y[k] / controller.resolution[k]).round()",
        "y[k] = (y[k] / controller.resolution[k]).floor()",
        "test_sampled",
    ),
    Mutant(
        "model/sampled.rs",
        "None => sample.min(self.first_after(origin, self.delay, t)),",
        "None => sample,",
        "test_sampled",
    ),
    Mutant(
        "stepping/lane_controller.rs",
        "if watched.instant.t < self.changed || watched.before_sample {",
        "if watched.before_sample {",
        "test_sampled",
    ),
    Mutant(
        "stepping/equal_lanes.rs",
        "run.place.sampled = Some(self.clock);",
        "",
        "test_sampled",
    ),
    Mutant(
        "stepping/adaptive_lanes.rs",
        "let now = system.evaluate(&self.batch.drive, self.places.tau, &here.y);",
        "let now = here.now;",
        "test_sampled",
    ),
    Mutant(
        "driver/environment.rs",
        "let next = periods * period + self.origin;",
        "let next = self.observed.t + period;",
        "test_simulator",
    ),
    Mutant(
        "driver/environment.rs",
        "let goes_on = status == Status::Completed && until < self.span.end;",
        "let goes_on = status == Status::Completed;",
        "test_simulator",
    ),
    Mutant(
        "driver/environment.rs",
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
)
