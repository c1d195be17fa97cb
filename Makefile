# make tables       build a small DeFAUST dataset, run the main methods, write tables and pictures to out/
# make test         lint, architecture rules, types, tests, and methods compared with their golden values
# make bench        times at full size, of drags and handle regions, up to 11 million vertices (an hour)
# make bench-paper  the paper's times and claims beside ours (ten minutes, of which three build data); TIMES=results
#                   writes into the published tables
# make robustness   tests of bad inputs, kills, fuzzing, reproducibility and coverage at full strength (an hour)
# make ablations    one change at a time, on two small bodies (a quarter of an hour)
# make transfers    poses rebuilt and transferred, at 20k and at 170k vertices (half an hour)
# make gallery      the pictures of the README, of docs/gallery.md and docs/applications.md (ten minutes)
# make update       everything that is generated from the code, after a change of it: the list of kernels, golden values,
#                   the record of the tests, tables and pictures of the pages (two hours, on a machine with Chromium)
# make verify       the paper's numbers beside yours, on your copies: FAUST=DIR TOSCA=DIR (15 hours for FAUST; go on
#                   with the same command)
# make docs         the documentation as a site, out/site; all its examples run (five minutes); pages link to
#                   the repository at REPOSITORY=https://...
# make release      wheel, source archive, site, Blender extension and dataset with its card in dist; nothing is
#                   uploaded (ten minutes); PYTHONS="python3.11 python3.12 ..." builds a wheel for each
# The first use makes .venv and installs. PYTHON=... chooses another interpreter. bench needs a quiet machine.

PYTHON ?= python3
PYTHONS ?= $(PYTHON)
# Tests at once: one for each CPU, and one more, because some of them wait.
WORKERS ?= $(shell $(BIN)/python -c 'from sshade.core.threads import available_cpus; print(available_cpus() + 1)')
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.installed
QUICK  := data/defaust_20k
VERIFY := data

FULL   := data/defaust_170k
SIZES  := 15625 19532
BASES  := $(SIZES:%=data/bench/%)
# Subdivided twice, it has the 450,000 vertices of a claim of the paper.
CLAIM  := data/bench/28125
TIMES  := out
BODY   := "defaust root=$(FULL) subject=0 pose=1"
# A lunge, on which Elastic and `fast` need many iterations.
HARD   := "defaust root=data/hard subject=11 pose=6"
REGIONS := "defaust root=$(FULL) subject=0 pose=1 handles=regions"
ONE    := "paper-1=paper samplings=1"
BOUND  := "paper-1=paper samplings=1 solver.start=rest" fast "fast-6000=fast vertices=6000"

# The ablations, and the settings of each.
ABLATIONS := $(addprefix ablation_,samplings vertices projection touching handles function frames coarse)
ablation_samplings  := experiment=ablation method.samplings='range(1,11)'
ablation_vertices   := experiment=ablation proxy.vertices=1000,1500,3000,5000
ablation_projection := experiment=ablation method=ablation/paper method.projection=fan,surface
ablation_touching   := dataset=hairpin dataset.gap=0.01,0.02,0.05,0.1 method=ablation/paper \
  method.projection=fan,surface proxy.vertices=500
ablation_handles    := experiment=ablation method=ablation/paper method.handle_mode=samples,nearest
ablation_function   := experiment=ablation method=ablation/paper method.frame_function=extent,best,x,y,z
ablation_frames     := experiment=ablation method=ablation/paper method.samplings=1,5 \
  method.frames=triangle,affine,blended,blended_affine label='paper-$${method.frames}-$${method.samplings}'
ablation_coarse     := experiment=ablation \
  method@method.proxy_method=accelerated_elastic,elastic,accelerated_arap,arap,arap_sr
TRANSFERS := isometric pose_transfer

# Runs of small experiments, one on each CPU. Their tables print no times.
AT_ONCE := hydra/launcher=joblib

# Whether a library of the system is there. Only Linux can lack one.
has = $(or $(wildcard $(BIN)/python),$(PYTHON)) -c 'import ctypes, sys; sys.platform != "linux" or ctypes.CDLL("$(1)")' 2>/dev/null

# With this variable, each of the hundreds of test processes would compile every module again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: tables test lint unit-tests golden-values ci-benchmark bench bench-paper robustness ablations transfers gallery update verify docs release clean
.PHONY: quick-figures quick-report system

tables: $(READY) $(QUICK)/dataset.json
	$(BIN)/sshade-eval run -m experiment=quick dataset.root=$(QUICK) $(AT_ONCE)
	$(BIN)/sshade-eval collect quick
	$(BIN)/sshade-eval tables quick
	$(MAKE) --no-print-directory -j2 quick-figures quick-report
	@echo "tables: out/tables; picture: out/figures; report with both: out/report.html"

quick-figures:
	@! $(call has,libEGL.so.1) || $(BIN)/sshade-eval figures quick

quick-report:
	$(BIN)/sshade-eval report quick

# Times are measured at the end, when nothing else runs.
test: $(READY)
	$(BIN)/python -m tools.compile_kernels
	$(MAKE) --no-print-directory -j2 unit-tests lint golden-values
	$(BIN)/sshade-eval check --only times

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/mypy

unit-tests: $(READY)
	$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal

golden-values: $(READY)
	$(BIN)/sshade-eval check --only values

ci-benchmark: $(READY)
	$(BIN)/sshade-eval check

# Needs a quiet machine: `sshade-eval bench` ends without a result if other programs run.
bench: $(READY) $(FULL)/dataset.json data/hard/dataset.json $(BASES:%=%/dataset.json) bench-paper
	$(BIN)/sshade-eval bench speed --cases $(BODY) --extrapolate arap elastic --methods arap elastic \
	  accelerated_arap accelerated_elastic deformation_graph paper $(ONE) fast fine
	$(BIN)/sshade-eval bench speed --name speed_hard --cases $(HARD) --extrapolate elastic --methods elastic \
	  accelerated_elastic deformation_graph paper fast fine
	$(BIN)/sshade-eval bench speed --name regions --cases $(REGIONS) --extrapolate elastic --methods elastic \
	  accelerated_elastic deformation_graph paper fast fine
	$(BIN)/sshade-eval bench drag --cases $(BODY) --methods $(BOUND)
	$(BIN)/sshade-eval bench drag --name drag_regions --cases $(REGIONS) --methods $(BOUND)
	$(BIN)/sshade-eval bench drag --name drag_large --sizes 1000000 \
	  --cases "defaust root=data/bench/15625 subject=0 pose=1" \
	  --methods fast "fast-6000=fast vertices=6000"
	$(BIN)/sshade-eval bench scaling --sizes 170000 683000 2700000 5000000 11000000 \
	  --cases $(BODY) "defaust root=data/bench/19532 subject=0 pose=1" --methods fast fine
	$(BIN)/sshade-eval bench whole --name startup --methods paper fast
	$(BIN)/sshade-eval bench whole --sizes 683000 11000000 --cases $(BODY) --methods fast

bench-paper: $(READY) $(FULL)/dataset.json $(CLAIM)/dataset.json
	$(BIN)/sshade-eval bench speed --name paper_speed -o $(TIMES) --cases $(BODY) \
	  --extrapolate arap elastic arap_sr --methods arap elastic arap_sr paper_plain paper fast fine
	$(BIN)/sshade-eval bench scaling --name paper_scaling -o $(TIMES) --sizes 28125 112500 450000 1800000 \
	  --cases "defaust root=$(CLAIM) subject=0 pose=1" --methods paper_plain paper
	$(BIN)/sshade-eval bench speed --name paper_transfer -o $(TIMES) \
	  --cases "defaust root=$(FULL) subject=0 pose=1 edit=inflate" --methods transfer/paper

# COVERAGE_FILE collects the coverage of all processes in this folder.
# The extras are needed for the coverage of baselines.
robustness: export COVERAGE_FILE := $(CURDIR)/.coverage
robustness: $(READY)
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt \
	  -e '.[bench,torch,neo-hookean]'
	$(BIN)/coverage erase
	$(BIN)/coverage run -m pytest -n 2 --dist worksteal --timeout=600
	$(BIN)/coverage combine -q
	for package in sshade baselines defaust eval; do \
	  $(BIN)/coverage report --skip-covered --include="$$package/*" --fail-under=93 || exit 1; done
	$(BIN)/python -m pytest -m "full or hypothesis" --hypothesis-profile=thorough -n 2 --timeout=3600
	$(BIN)/sshade-eval check --full

ablations: $(READY) $(QUICK)/dataset.json
	$(foreach name,$(ABLATIONS),$(BIN)/sshade-eval run -m $($(name)) run.experiment=$(name) &&) true
	$(BIN)/sshade-eval collect $(ABLATIONS)
	$(BIN)/sshade-eval tables $(ABLATIONS)
	$(BIN)/sshade-eval figures ablation_touching

transfers: $(READY) $(FULL)/dataset.json
	for name in $(TRANSFERS); do $(BIN)/sshade-eval run -m experiment=$$name || exit 1; done
	$(BIN)/sshade-eval collect $(TRANSFERS)
	$(BIN)/sshade-eval tables $(TRANSFERS)
	$(BIN)/sshade-eval figures isometric
	$(BIN)/sshade-eval figures pose_transfer

gallery: $(READY)
	$(BIN)/python -m docs.drag
	$(BIN)/python -m docs.gallery
	$(BIN)/python -m docs.applications

# Tests that begin with an empty store of kernels call all that the list must have. Those of the list fail until it is
# written. `check` refuses changed values where no version has risen.
update: $(READY) $(QUICK)/dataset.json data/defaust/dataset.json data/noisy_25k_2mm/dataset.json
	rm -rf out/kernels
	-SSHADE_KERNELS=$(CURDIR)/out/kernels $(BIN)/python -m pytest -n $(WORKERS) --dist worksteal --timeout=600
	$(BIN)/python -m tools.compile_kernels --update --into out/kernels
	$(BIN)/sshade-eval check --write
	$(BIN)/python -m tests.record
	$(BIN)/python -m docs.pages
	$(BIN)/python -m docs.pictures
	$(MAKE) --no-print-directory gallery

# BUILD and RUN have further settings, such as BUILD=subjects=[0,1] and RUN="subject=0 pose=1" for a first look.
verify: $(READY)
	@test -n "$(FAUST)$(TOSCA)" || { echo "name the folder of your copy: make verify FAUST=MPI-FAUST TOSCA=..."; exit 2; }
ifdef FAUST
	$(BIN)/defaust build source=faust source.root="'$(FAUST)'" out=$(VERIFY)/faust static_below=0.05 $(BUILD)
	$(call verify,faust,table1_lowres)
	$(call verify,faust,table1)
endif
ifdef TOSCA
	$(BIN)/defaust build source=tosca source.root="'$(TOSCA)'" out=$(VERIFY)/tosca $(BUILD)
	$(call verify,tosca,isometric)
endif
	$(BIN)/sshade-eval tables --paper $(if $(FAUST),faust) $(if $(TOSCA),tosca)

# Runs of an experiment on a dataset. A failed run (exit code 1) has a row, and the next experiment begins.
verify = { $(BIN)/sshade-eval run -m $($(2)) dataset.root=$(VERIFY)/$(1) run.experiment=$(2)_$(1) $(RUN) \
	  || test $$? -eq 1; } && $(BIN)/sshade-eval collect $(2)_$(1)

table1_lowres := experiment=table1 pose=all dataset.resolution=low method=arap,elastic,arap_sr
table1 := experiment=table1 pose=all method=arap,elastic,arap_sr,implicit_arap_cpu,paper_plain
isometric := experiment=isometric method=transfer/paper run.split=both pose=all method.frames=triangle method.samplings=10

docs: $(READY) $(QUICK)/dataset.json
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e '.[bench,docs]'
	$(BIN)/python -m mkdocs build
	@echo "the site is in out/site"

# A wheel is for one Python. Each must deform a mesh in a fresh environment, and must not compile any kernel there. Its
# kernels are data: it has no library that is linked with the system, so on Linux it gets the tag that package indexes
# take. The extension is for the Python of the clone.
release: docs
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e '.[release]'
	rm -rf dist out/release
	$(BIN)/python -m build --sdist
	$(BIN)/defaust example out/release/body
	@set -e; for python in $(PYTHONS); do \
	  rm -rf out/release/fresh out/release/wheel; \
	  $$python -m venv out/release/fresh; \
	  out/release/fresh/bin/python -m pip wheel -q --no-deps -w out/release/wheel dist/*.tar.gz; \
	  case "$$(uname)" in Linux) $(BIN)/python -m wheel tags --remove \
	    --platform-tag manylinux_2_17_$$(uname -m) out/release/wheel/*.whl;; esac; \
	  out/release/fresh/bin/python -m pip install -q --disable-pip-version-check out/release/wheel/*.whl; \
	  out/release/fresh/bin/sshade deform out/release/body/rest.ply out/release/body/pose_6.json \
	    -o out/release/posed.ply --overwrite 2> out/release/said; \
	  if grep compiling out/release/said; then exit 1; fi; \
	  mv out/release/wheel/*.whl dist; \
	done
	$(BIN)/twine check --strict dist/*
	$(BIN)/sshade blender -o dist/sshade-blender.zip
	$(BIN)/defaust verify $(QUICK)
	$(BIN)/python -m zipfile -c dist/$(notdir $(QUICK)).zip $(QUICK)
	$(BIN)/python -m zipfile -c dist/site.zip out/site
	@echo "the files are in dist; nothing was uploaded"

$(FULL)/dataset.json: $(READY)
	$(BIN)/defaust build source=synthetic out=$(FULL) subjects=[0]

data/defaust/dataset.json: $(READY)
	$(BIN)/defaust build source=synthetic out=data/defaust

data/noisy_25k_2mm/dataset.json: $(READY)
	$(BIN)/defaust build source=noisy source.noise=2 out=data/noisy_25k_2mm target_vertices=25000

data/bench/%/dataset.json: $(READY)
	$(BIN)/defaust build source=synthetic out=data/bench/$* subjects=[0] target_vertices=$*

data/hard/dataset.json: $(READY)
	$(BIN)/defaust build source=new_bodies out=data/hard subjects=[11]

$(QUICK)/dataset.json: $(READY)
	$(BIN)/defaust build source=synthetic out=$(QUICK) subjects=[0,1] target_vertices=20000

# Without compilation by pip, installation takes half the time: imports compile the few modules that are used.
$(READY): pyproject.toml constraints.txt | system
	@begin=$$(date +%s); \
	  $(PYTHON) -m venv $(VENV) \
	  && $(BIN)/python -m pip install -q --disable-pip-version-check --no-compile -c constraints.txt \
	    -e '.[bench,figures,formats,test]' \
	  && $(BIN)/python -m tools.compile_kernels \
	  && touch $@ && echo "installed into $(VENV) in $$(( $$(date +%s) - begin )) s"

system:
	@test -e $(READY) || $(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "Python 3.11 or newer is needed: make PYTHON=/path/to/python3.11 ..."; exit 2; }
	@$(call has,libGL.so.1) \
	  || { echo "pymeshlab needs the system library libGL.so.1 (Debian, Ubuntu: apt install libgl1)"; exit 2; }
	@$(call has,libEGL.so.1) || echo "there will be no pictures: they need the system library libEGL.so.1" \
	  "(Debian, Ubuntu: apt install libegl1 libgl1-mesa-dri)"

clean:
	rm -rf $(VENV) data out
