# What there is to do; `just` (https://just.systems) lists it. Every recipe is one line, which works without just, too.

# List the recipes
default:
  @just --list

# The demo: a map on screen, served at http://127.0.0.1:8080
demo:
  cargo run --release -- demo

# Everything that CI asks for
ci:
  .ci/run

# Every test; with arguments, cargo's alone: just test --test experiment_one
test *arguments:
  scripts/test {{arguments}}

# Format Rust and Python
format:
  cargo fmt --all && clients/python/.venv/bin/ruff format clients/python

# Lints, as CI asks for them
lint:
  cargo clippy --release --all-targets -- -D warnings

# Licences, sources and forbidden crates of the dependencies
deny:
  scripts/deny

# Build the documentation's site into target/site
site:
  scripts/site

# Do what the documentation's pages say, against a service
pages:
  MAPFIT_BINARY=target/release/mapfit scripts/pages

# The console's checks: types, format, units, that its built files are those of its sources, and all of it in a browser
console:
  scripts/console

# The Python client's checks
client *arguments:
  MAPFIT_BINARY=target/release/mapfit clients/python/test {{arguments}}

# The benchmarks of the kernels
bench:
  cargo bench

# Renew openapi/openapi.json after a change of routes or schemas
openapi:
  MAPFIT_BLESS=1 cargo test --release --test openapi

# Renew docs/calibration.md (hours)
calibration:
  scripts/calibration

# Renew docs/performance.md (builds other solvers; hours)
peers:
  scripts/peers

# Renew docs/reproduction.md and its figures
reproduce:
  scripts/reproduce
