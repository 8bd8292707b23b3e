# Every command explains itself: `make help`.
.DEFAULT_GOAL := help
SHELL := /bin/bash
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?= results
FORMAT ?= png
RUST := Cargo.toml Cargo.lock $(shell find rust -name '*.rs' -o -name Cargo.toml)

.PHONY: help
help: ## Show the commands
	@grep -E '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 20

$(VENV)/.base: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade 'pip>=25.1'
	$(BIN)/python -m pip install --quiet 'maturin>=1.9,<2'
	@touch $@

# What the extras and the developers need: `make lint` and `make docs` work with it before the core is built.
EXTRAS := import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["all"], sep="\n")
$(VENV)/.dev: $(VENV)/.base
	$(BIN)/python -c '$(EXTRAS)' | $(BIN)/python -m pip install --quiet --group dev --requirement /dev/stdin
	@touch $@

# The compiler needs minutes, most of them on one core, and nothing from the index of Python's packages.
MATURIN := VIRTUAL_ENV=$(abspath $(VENV)) $(BIN)/maturin develop --release --locked --quiet
$(VENV)/.core: $(VENV)/.base $(RUST)
	$(MATURIN) --skip-install >/dev/null
	@touch $@

# What pip finds installed already goes to stdout, whatever --quiet says; errors go to stderr.
# (PIP_QUIET would hush `pip show` too, from which maturin learns where the package is.)
$(VENV)/.built: $(VENV)/.core $(VENV)/.dev
	$(MATURIN) >/dev/null
	@touch $@

.PHONY: build
build: $(VENV)/.built ## Build the core and install the package, editable, into .venv

.PHONY: build-time
build-time: ## Build the module from nothing, elsewhere, and print how long each stage takes
	$(PYTHON) tools/build_time.py

.PHONY: reproduce
reproduce: build ## Run the paper's simulation: figures (FORMAT, png) and CSV tables into OUT (results)
	$(BIN)/softpinch reproduce --out $(OUT) --format $(FORMAT)

.PHONY: figures
figures: build ## Make the pictures of README and docs again
	$(BIN)/softpinch reproduce --out $(OUT)
	$(BIN)/softpinch montecarlo examples/studies/disturbance_ii.toml --runs 20000 --out $(OUT)/study
	mkdir -p docs/figures && cp $(OUT)/*.png $(OUT)/study/success_map.png docs/figures/
	$(BIN)/python tools/architecture.py
	$(BIN)/python tools/model_drawing.py
	$(BIN)/python tools/contact_modes.py
	$(BIN)/python tools/own_hands.py
	$(BIN)/python tools/equilibria.py
	$(BIN)/python examples/05_train_a_policy.py docs/figures/learning_curve.png
	$(BIN)/python examples/06_computed_torque.py docs/figures/computed_torque.png
	$(BIN)/python examples/07_admittance.py docs/figures/admittance.png
	$(BIN)/python examples/08_lqr.py docs/figures/lqr.png
	$(BIN)/python examples/09_grasp_quality.py docs/figures/grasp_quality.png
	$(BIN)/python examples/10_fit.py docs/figures/fit.png
	$(BIN)/python examples/11_smooth_move.py docs/figures/smooth_move.png
	$(BIN)/python examples/12_softest_tip.py docs/figures/softest_tip.png
	$(BIN)/python examples/13_carried_by_an_arm.py docs/figures/carried_by_an_arm.png
	$(BIN)/python examples/14_a_bottle_in_jaws.py docs/figures/a_bottle_in_jaws.png
	$(BIN)/python examples/15_how_rarely_it_fails.py docs/figures/how_rarely_it_fails.png
	$(BIN)/python examples/16_camera_and_servo.py docs/figures/camera_and_servo.png

# Every warning is an error; --keep-going shows all of them.
SITE := $(BIN)/python -m sphinx --builder html --fail-on-warning --keep-going --nitpicky --fresh-env --quiet docs build/docs
.PHONY: docs
docs: build ## Build the site into build/docs, and run the examples of its gallery
	rm -rf docs/gallery # an example whose text is the same would not be run again
	$(SITE)

.PHONY: docs-quick
docs-quick: build ## Build the site without running the examples
	$(SITE) -D plot_gallery=0

.PHONY: test
test: ## Everything that a landing must pass: lint, Rust tests, Python tests
	@# The release build keeps one core busy for minutes, in which the other can check. Everything waits for it, so
	@# the checks leave it what it needs. A third job, because one waits for the network while it installs. Stubs need
	@# the module, and one core.
	$(MAKE) --jobs 3 --output-sync=line CHECK=nice build lint-rust lint-python test-rust
	$(MAKE) --jobs 2 CHECK=nice test-python lint-stubs

.PHONY: lint lint-rust lint-python lint-stubs
lint: lint-rust lint-python lint-stubs ## Format, clippy, missing docs, ruff, mypy strict, stubtest
lint-rust:
	cargo fmt --all --check
	$(CHECK) cargo clippy --workspace --all-targets --locked --quiet -- -D warnings
	RUSTDOCFLAGS='-D warnings' $(CHECK) cargo doc --package softpinch --no-deps --locked --quiet
lint-python: $(VENV)/.dev
	$(BIN)/ruff format --check --quiet .
	$(BIN)/ruff check --quiet .
	$(CHECK) $(BIN)/mypy --no-error-summary
	$(CHECK) $(BIN)/mypy --no-error-summary tests/support/typed_uses.py
lint-stubs: build
	$(CHECK) $(BIN)/python -m mypy.stubtest softpinch._core --concise

# The examples that check something are among the library's tests; clippy compiles all. Code that is not
# optimised keeps every copy of a state on the stack, which is larger than a test's thread has.
test-rust operations: export RUST_MIN_STACK := 67108864
# The same random examples for everyone; `make hunt` draws new ones.
test-rust: export PROPTEST_RNG_SEED ?= 1
.PHONY: test-rust
test-rust: ## The core's own tests
	$(CHECK) cargo test --profile tested --locked --quiet --package softpinch --lib

.PHONY: test-python
test-python: build ## pytest and Hypothesis, on all cores
	$(BIN)/python -m pytest --quiet --numprocesses logical --dist worksteal

.PHONY: test-slow
test-slow: build ## The long sweeps that `make test` leaves out
	$(BIN)/python -m pytest --quiet -m slow

# A few hundred rounds overnight are the long hunt. A round draws its examples from its seed alone.
SEED ?= $(shell od -An -N4 -tu4 /dev/urandom)
ROUNDS ?= 1
TESTS ?= tests
.PHONY: hunt
hunt: build ## Property tests with new random examples: TESTS (tests), from SEED (random) on, ROUNDS (1) seeds
	@first=$(strip $(SEED)); for ((seed = first; seed < first + $(ROUNDS); seed++)); do \
	  echo "make hunt SEED=$$seed TESTS='$(TESTS)'"; \
	  if [ '$(TESTS)' = tests ]; then $(MAKE) test-rust PROPTEST_RNG_SEED=$$seed || exit; fi; \
	  $(BIN)/python -m pytest --quiet -m 'hypothesis and not slow' --hypothesis-profile hunt \
	    --hypothesis-seed $$seed --numprocesses logical --dist worksteal $(TESTS) || exit; \
	done

.PHONY: digests
digests: build ## Store the bits of today's results, after RESULTS_VERSION was raised
	$(BIN)/python tests/support/digests.py

.PHONY: rare-truth
rare-truth: build ## Compute plain runs of scenes with rare events, and store their probabilities; continues from those that are stored, takes hours
	$(BIN)/python tests/support/rare_scenes.py

.PHONY: operations
operations: ## Count the operations of today's equations, and write the table of the benchmarks
	cargo test --profile tested --locked --quiet --package softpinch --lib write_the_table -- --ignored

.PHONY: mutants
mutants: build ## Break the core on purpose, place by place, and see the tests turn red
	$(BIN)/python tools/mutants.py

.PHONY: format
format: $(VENV)/.dev ## Format Rust and Python
	cargo fmt --all
	$(BIN)/ruff format --quiet .
	$(BIN)/ruff check --quiet --fix .

.PHONY: bench
bench: build ## Time the lone run beside SciPy
	$(BIN)/python benchmarks/single_run.py

# Without a Fortran compiler numbalsoda is left out, as is Drake where it has no wheel, and the
# benchmarks say so. The ensembles' peer in C++ is measured with g++ and with clang++, whichever is
# installed.
$(VENV)/.peers: $(VENV)/.dev
	$(BIN)/python -m pip install --quiet --group peers
	-$(BIN)/python -m pip install --quiet --group peers-fortran
	-$(BIN)/python -m pip install --quiet --group peers-drake
	@touch $@

.PHONY: bench-integrators
bench-integrators: build $(VENV)/.peers ## Time formulations and methods beside compiled peers
	$(BIN)/python benchmarks/integrators.py

.PHONY: bench-ensemble
bench-ensemble: build $(VENV)/.peers ## Time ensembles beside compiled peers
	$(BIN)/python benchmarks/ensemble.py

# Siconos takes part where Debian's python3-siconos is installed.
.PHONY: bench-contact
bench-contact: build $(VENV)/.peers ## Time unilateral beside bilateral contact, and beside Siconos and MuJoCo
	$(BIN)/python benchmarks/contact.py

.PHONY: bench-parts
bench-parts: build ## Time a step with each kind of finger, side and law beside the paper's
	$(BIN)/python benchmarks/parts.py

.PHONY: bench-creep
bench-creep: build $(VENV)/.peers ## Hold a grasp for 1000 s beside MuJoCo, and see which one creeps
	$(BIN)/python benchmarks/creep.py

.PHONY: bench-carry
bench-carry: build $(VENV)/.peers ## Move a grasp 1000 times back and forth beside MuJoCo and Drake, and see what slides out
	$(BIN)/python benchmarks/carry.py

.PHONY: bench-reference
bench-reference: build $(VENV)/.peers ## Measure Siconos, MuJoCo and Drake by the reference problems, and write docs/reference-problems.md again
	$(BIN)/python benchmarks/reference.py

.PHONY: reference
reference: build ## Write the reference problems and their solutions again; takes half an hour
	PYTHONPATH=tests $(BIN)/python reference/generate.py

.PHONY: bench-stepping
bench-stepping: build $(VENV)/.peers ## Time stepping from outside beside MuJoCo, and write docs/control.md's tables again
	$(BIN)/python benchmarks/stepping.py

.PHONY: bench-equilibrium
bench-equilibrium: build ## Time equilibria and linear models beside SciPy, and write docs/equilibria.md's table again
	$(BIN)/python benchmarks/equilibrium.py

.PHONY: bench-sensitivity
bench-sensitivity: build ## Time derivatives of runs beside finite differences, and write docs/derivatives.md's tables again
	$(BIN)/python benchmarks/sensitivity.py

.PHONY: bench-import
bench-import: build ## Time `import softpinch` beside NumPy's own
	$(BIN)/python benchmarks/import_time.py

.PHONY: bench-animation
bench-animation: build ## Time the frames of a film
	$(BIN)/python benchmarks/animation.py

.PHONY: bench-ablation
bench-ablation: build ## Measure what each part of a scene costs, and write docs/what-a-scene-pays.md's tables again
	$(BIN)/python benchmarks/ablation.py

.PHONY: bench-odds
bench-odds: build ## Compute how likely a grasp holds with real friction, and write docs/unilateral.md's tables again
	$(BIN)/python benchmarks/contact_odds.py

.PHONY: bench-rare
bench-rare: build ## Measure rare events beside plain runs, and beside OpenTURNS where it is installed
	$(BIN)/python benchmarks/rare.py

.PHONY: bench-stopping
bench-stopping: build ## Measure how often intervals of stopped studies are right, and write docs/ensembles.md's table again
	$(BIN)/python benchmarks/stopping.py

.PHONY: bench-scale
bench-scale: build ## Measure processes, Dask and the store, and write docs/scale-out.md's tables again
	$(BIN)/python benchmarks/scale.py --document

.PHONY: reports
reports: build $(VENV)/.peers ## Measure and write docs/error-against-run-time.md and docs/stability.md again
	$(BIN)/python benchmarks/reports.py

.PHONY: wheel
wheel: $(VENV)/.base ## Build wheel and sdist into dist, and time each from `pip install` to its first run in an empty environment
	$(PYTHON) tools/wheel.py $(BIN)/maturin dist

.PHONY: clean
clean: ## Remove what was built
	rm -rf $(VENV) target results dist build docs/gallery
