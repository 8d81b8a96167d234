# Every target installs what is missing first: on Debian 12 and 13 Debian's own packages by apt-get, the rest into .venv;
# elsewhere, or with FROM=pip, all into .venv-pip, without root. `make help` lists them.
RANKS ?= 2
STUDY ?= tensile
ARGS ?=
# Runs the tests with this marker alone, e.g. `versions` (or what else pytest's -m takes).
ONLY ?=
# What `make test` leaves out.
SKIP ?= and not long
DEBIAN13_ROOT ?= .debian13/root
SID_ROOT ?= .debian13/sid
# Processes of the tests on one rank: one more than cores, as some wait for others that they start.
WORKERS ?= $(shell echo $$(($$(env -u OMP_NUM_THREADS nproc) + 1)))
# Seconds after which the ranks of a test run count as hung: far beyond what they take on a machine with other work.
TEST_TIMEOUT ?= 21600

# The one list of Debian packages. With OpenBLAS MUMPS factorises a forming step five times faster than with the default.
# Debian 13 has all (meshio reads Exodus by netCDF4 there, PyVista elsewhere); what Debian 12 lacks pip fetches, and to draw
# without a screen VTK's wheel there wants EGL, Debian 13's VTK an X server.
PACKAGES := python3-dolfinx-real python3-petsc4py python3-mpi4py python3-gmsh python3-meshio python3-scipy python3-matplotlib python3-jinja2 \
  python3-pip python3-setuptools gcc g++ libc6-dev python3-dev openmpi-bin libopenblas0-serial
PACKAGES_12 := libegl1
PACKAGES_13 := python3-pyvista python3-numba python3-ezdxf python3-shapely python3-h5py python3-netcdf4 xvfb xauth python3-pytest python3-pytest-xdist python3-hypothesis python3-mpmath python3-tomli-w python3-tqdm python3-lazy-loader
DEBIAN := $(shell . /etc/os-release 2>/dev/null && [ "$$ID" = debian ] && echo "$${VERSION_ID:-sid}")
ifeq ($(DEBIAN),12)
NEEDS := $(PACKAGES) $(PACKAGES_12)
# numpy stays the one that dolfinx was built with.
PIP_ARGS = "numpy==$$(/usr/bin/python3 -c 'import numpy; print(numpy.__version__)')"
else
NEEDS := $(PACKAGES) $(PACKAGES_13)
PIP_ARGS := --no-deps
SCREEN := $(if $(DISPLAY),,xvfb-run -a)
endif

# Where DOLFINx comes from: debian, if its packages are there or can be installed, else pip.
FROM ?= $(if $(filter-out 10 11,$(DEBIAN)),$(shell .ci/need --can $(NEEDS) && echo debian || echo pip),pip)
$(if $(filter debian pip,$(FROM)),,$(error FROM is $(FROM); allowed is debian or pip))

# Open MPI: may run as root, and stays inside this machine (shared memory; no single copy, which containers forbid). What
# Debian leaves out of its networks is left out here, too: without that each process waits 1.5 s for them.
export OMPI_ALLOW_RUN_AS_ROOT := 1
export OMPI_ALLOW_RUN_AS_ROOT_CONFIRM := 1
export OMPI_MCA_pml := ob1
export OMPI_MCA_btl := ^tcp,uct,openib,ofi
export OMPI_MCA_btl_vader_single_copy_mechanism := none
export OMP_NUM_THREADS := 1
# Python keeps what it has compiled, which each of many processes would do again.
export PYTHONDONTWRITEBYTECODE :=
# Files that hold tests on ranks.
MPI_FILES = $(shell grep -l mark.mpi tests/test_*.py tests/*/test_*.py tests/*/*/test_*.py)
ifeq ($(FROM),pip)
# A process of MPICH has 2048 communicators, and on ranks PETSc keeps those of scenes that are gone: a process for each file,
# unless few tests are asked for.
MPI_PARTS = $(if $(ONLY),"$(MPI_FILES)",$(MPI_FILES))
VENV := .venv-pip
MPIRUN := $(VENV)/bin/mpiexec -n $(RANKS)
TEST_MPIRUN := MPIEXEC_TIMEOUT=$(TEST_TIMEOUT) $(MPIRUN)
SCREEN :=
else
MPI_PARTS = "$(MPI_FILES)"
VENV := .venv
# Ranks may outnumber cores, and give one up while they wait: two that spin cost a machine with other work minutes.
MPIRUN = mpirun.openmpi --map-by :OVERSUBSCRIBE --bind-to none --mca mpi_yield_when_idle 1 -n $(RANKS)
TEST_MPIRUN = $(MPIRUN) --timeout $(TEST_TIMEOUT)
endif
PYTHON := $(VENV)/bin/python

.PHONY: help install install-lint install-docs study test test-all mutants bench-hard lint docs numbers pictures debian13-root test-debian13 sid-root test-sid test-pip clean

help:
	@echo "make study          STUDY=$(STUDY) on RANKS=$(RANKS) ranks; options in ARGS=\"...\" (without any: --overwrite)"
	@echo "                    FROM=pip (the default where Debian or root is missing): DOLFINx from pip, without root"
	@echo "make test           the tests, but for those marked long: on one rank, those marked mpi on RANKS=$(RANKS)"
	@echo "                    ONLY=MARKER: just the tests with this marker, here and in the four below"
	@echo "make test-all       the whole suite"
	@echo "make mutants        slips in the package that the tests must notice; ARGS=\"AREA ... --share N\": some of them"
	@echo "make test-pip       the same suite on DOLFINx from pip, in a Python 3.12 or later; CI: ONLY=versions"
	@echo "make test-debian13  the same suite in a Debian 13 root, made in DEBIAN13_ROOT=$(DEBIAN13_ROOT) (root or sudo); CI: ONLY=versions"
	@echo "make test-sid       the same suite in a root of Debian unstable, made in SID_ROOT=$(SID_ROOT) (root or sudo)"
	@echo "make bench-hard     hard cases of the solver: load, number and iterations of each, in 15 minutes at most"
	@echo "make lint           ruff and mypy, as CI runs them first"
	@echo "make docs           the documentation into build/docs (open build/docs/index.html)"
	@echo "make numbers        the numbers of README and the pages anew; ARGS=\"--long --times\": those of minutes, and times"
	@echo "make pictures       the documentation's pictures anew, from docs/examples"
	@echo "make install        only install what the others need"
	@echo "make clean          remove environments and caches; keeps results/ and the Debian roots"

install: $(VENV)/prepared

study: $(VENV)/prepared
	$(SCREEN) $(MPIRUN) $(PYTHON) $(or $(wildcard benchmarks/$(STUDY).py),studies/$(STUDY).py) $(or $(ARGS),--overwrite)

test: $(VENV)/installed
	$(SCREEN) $(PYTHON) -m pytest -n $(WORKERS) --dist worksteal --durations 20 -m "not mpi $(SKIP)$(if $(ONLY), and ($(ONLY)))" tests || { cat .pytest_cache/crash_*.txt; exit 1; }
	for part in $(MPI_PARTS); do \
	  $(SCREEN) $(TEST_MPIRUN) $(PYTHON) .ci/pytest_on_ranks.py $$part -m "mpi $(SKIP)$(if $(ONLY), and ($(ONLY)))" -xq --color=no -p no:cacheprovider || exit 1; done

test-all:
	@$(MAKE) test SKIP=

mutants: $(VENV)/installed
	$(SCREEN) $(PYTHON) tests/mutants/run.py --jobs $$(env -u OMP_NUM_THREADS nproc) $(ARGS)

bench-hard: $(VENV)/prepared
	$(PYTHON) benchmarks/hard_cases.py --overwrite --no-pictures

install-lint install-docs: install-%: $(VENV)/installed-%

lint: install-lint
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .
	$(PYTHON) -m mypy

docs: $(VENV)/installed-docs
	$(PYTHON) -m sphinx --builder html --fail-on-warning --keep-going --quiet docs build/docs

numbers: $(VENV)/prepared
	$(SCREEN) $(PYTHON) docs/page_numbers.py $(ARGS)

pictures: $(VENV)/installed
	$(SCREEN) $(PYTHON) docs/pictures.py

# Forms and loops are compiled once, so that the first study does not wait for it.
$(VENV)/prepared: $(VENV)/installed
	$(PYTHON) -m fabric_fenicsx prepare
	@touch $@

# What an extra of pyproject.toml lists and nothing else, so that the packages of the program stay as they are.
$(VENV)/installed-%: $(VENV)/installed
	$(PYTHON) -m pip install --quiet $$($(PYTHON) -c "import tomllib; print(*tomllib.load(open('pyproject.toml', 'rb'))['project']['optional-dependencies']['$*'])")
	@touch $@

# Debian's python3, as the one on PATH may lack dolfinx.
.venv/installed: Makefile pyproject.toml
	@.ci/need $(NEEDS)
	/usr/bin/python3 -m venv --system-site-packages --without-pip .venv
	.venv/bin/python -m pip install --quiet --no-build-isolation --editable ".[test]" $(PIP_ARGS)
	@touch $@

# PIP_PYTHON: a Python 3.12 or later; by default the first that is found.
.venv-pip/installed: Makefile pyproject.toml
	@python=$${PIP_PYTHON:-$$(.ci/python)} && "$$python" -m venv .venv-pip
	.venv-pip/bin/python -m pip install --quiet --editable ".[dolfinx,test]"
	@touch $@

test-pip:
	@$(MAKE) test FROM=pip

debian13-root:
	@.ci/debian13 root "$(DEBIAN13_ROOT)" $(sort $(PACKAGES) $(PACKAGES_13) make)

test-debian13: debian13-root
	@.ci/debian13 test "$(DEBIAN13_ROOT)" "$(ONLY)"

sid-root:
	@SUITE=sid .ci/debian13 root "$(SID_ROOT)" $(sort $(PACKAGES) $(PACKAGES_13) make)

test-sid: sid-root
	@SUITE=sid .ci/debian13 test "$(SID_ROOT)" "$(ONLY)"

clean:
	rm -rf .venv .venv-pip build docs/api/generated *.egg-info .pytest_cache .mypy_cache .ruff_cache
	find . -name .debian13 -prune -o -name __pycache__ -exec rm -rf {} +
