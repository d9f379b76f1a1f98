# The commands a newcomer types: `make run` and `make test`.

# Where `make run` serves.
LISTEN ?= 127.0.0.1:8080
# ONCE=1 ends `make run` after the report.
ONCE ?=

# Of `make package` and `make test-package`: the architecture, where it is not the machine's own (arm64).
ARCH ?=

.PHONY: run check test test-long test-hardware test-vendor-clients test-schemathesis package test-package bench web fmt clean

run:
	@deploy/setup.sh build
	@$(MAKE) --no-print-directory web
	@echo "building plenalign (release; the first time takes some minutes)"
	@cargo build --release --quiet
	@exec target/release/plenalign demo --listen $(LISTEN) $(if $(ONCE),--once)

# What one runs before a commit: format, clippy, unit tests, contract, structure. `make test` has the rest.
check:
	@cargo fmt --check
	@. tests/lints.sh && cargo test --quiet --no-run --all-targets && cargo test --quiet --lib && \
		cargo test --quiet --test integration -- contract:: structure:: docs::

test:
	@tests/checks.sh

# The camera's driver against a real kernel's virtual cameras, in a guest under QEMU.
test-hardware:
	@tests/hardware/run.sh $(TESTS)

test-long:
	@tests/long.sh

# The controller twins against the vendors' own clients.
test-vendor-clients:
	@tests/vendor-clients/run.sh

# The contract tried on the daemon; EXAMPLES=200 tries more.
test-schemathesis:
	@tests/schemathesis/run.sh

# The Debian package, into target/package/; ARCH=arm64 for that on an amd64 machine.
package:
	@$(if $(ARCH),ARCH=$(ARCH)) deploy/package.sh

# Builds it (of the program that tests run; PROFILE=dist as `make package` does), checks it, and installs it in Debian systems of its own.
test-package:
	@$(if $(ARCH),ARCH=$(ARCH)) tests/package/run.sh

# Every benchmark, and one table of ratios; BENCH_PAGE=docs/benchmarks.md puts it there, too.
bench:
	@deploy/setup.sh bench
	@benches/run.sh

# The page, embedded in the binary. Rebuilt only when its sources have changed.
web: web/dist/index.html

web/dist/index.html: docs/glossary.md $(shell find web -path web/node_modules -prune -o -path web/dist -prune -o -type f -print 2>/dev/null)
	@echo "building the page"
	@cd web && npm ci --loglevel=error --no-audit --no-fund && npm run --silent build
	@touch $@

fmt:
	cargo fmt

clean:
	cargo clean
	rm -rf web/dist web/node_modules
