# Every target but `setup` uses .venv in this checkout and builds it if it is missing.
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.ready
WORKERS ?= 2
DEMO := rm3d_votenet_kitti_1pct

.PHONY: setup demo annotate test browser fuzz faults mmdet3d lint types layers bench docs dist try-dist clean

setup: $(STAMP)

$(STAMP): setup.py constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet -c constraints.txt 'setuptools>=77.0.3,<82' wheel
	$(BIN)/pip install --quiet -c constraints.txt --no-build-isolation -e '.[standalone,test,docs,las,annotate]'
	touch $(STAMP)

demo: $(STAMP)
	$(BIN)/rm3d train $(DEMO) --demo

annotate: $(STAMP)
	$(BIN)/rm3d annotate --demo --classes floor wall chair table

# Two processes at a time: one has about 1.2 GB. WORKERS=0 is one process, in which a debugger works.
test: $(STAMP)
	$(BIN)/python -m pytest -q -n $(WORKERS) --dist loadgroup --no-loadscope-reorder

# rm3d annotate in Chromium (Debian: apt-get install chromium); the processor draws its graphics, so a machine that is too
# busy is told and passed over. A page that draws and gives a wrong answer, or none, fails.
browser: $(STAMP)
	RM3D_BROWSER=1 timeout -k 10 270 $(BIN)/python -m pytest -q -s -rs tests/annotation/test_browser.py || \
	  case $$? in 124|137) echo 'browser: not done in 270 s, too busy a machine: passed over';; *) exit 1;; esac

fuzz: $(STAMP)
	RM3D_FUZZ=3000 $(BIN)/python -m pytest -q tests/storage/test_fuzz_readers.py
	RM3D_FUZZ=500 $(BIN)/python -m pytest -q -s tests/storage/test_fuzz_stores.py tests/commands/test_fuzz_commands.py

faults: $(STAMP)
	RM3D_FAULTS=25 $(BIN)/python -m pytest -q tests/faults tests/annotation/test_killed.py

# mmdetection3d 1.4 beside current torch: without its compiled operations, in an environment of its own.
mmdet3d:
	$(PYTHON) -m venv .venv-mmdet3d
	grep -vE '^(numpy|setuptools)==' constraints.txt > .venv-mmdet3d/constraints.txt
	.venv-mmdet3d/bin/pip install --quiet -c .venv-mmdet3d/constraints.txt 'setuptools>=77.0.3,<81' wheel 'numpy<2.4'
	.venv-mmdet3d/bin/pip install --quiet -c .venv-mmdet3d/constraints.txt --no-build-isolation -e '.[standalone,test]' \
	  'setuptools<81' 'numpy<2.4'
	.venv-mmdet3d/bin/pip install --quiet --no-deps mmcv-lite==2.1.0 mmdet==3.3.0 mmdet3d==1.4.0 nuscenes-devkit==1.2.0 \
	  lyft_dataset_sdk pyquaternion pandas scikit-learn threadpoolctl narwhals pycocotools shapely terminaltables \
	  trimesh plyfile six
	.venv-mmdet3d/bin/python -m pytest -q tests/parts

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP)
	$(BIN)/mypy

layers: $(STAMP)
	$(BIN)/lint-imports

bench: $(STAMP)
	$(BIN)/rm3d bench --help

docs: $(STAMP)
	$(BIN)/mkdocs build --strict

# Wheel and sdist; the wheel is built from the sdist, so that the sdist is whole.
dist: $(STAMP)
	rm -rf dist build
	$(BIN)/python setup.py --quiet sdist
	$(BIN)/pip wheel --quiet --no-deps --no-build-isolation --wheel-dir dist dist/*.tar.gz
	ls -l dist

# The wheel in an environment of its own: make try-dist PYTHON=python3.13
try-dist: dist
	rm -rf build/try && $(PYTHON) -m venv build/try
	build/try/bin/pip install --quiet -c constraints.txt "$$(ls dist/*.whl)[standalone]"
	cd build/try && bin/rm3d info && bin/rm3d train rm3d_sem_scannet_0p2pct --demo --work-dir run --cfg-options \
	  demo_data.num_train=2 demo_data.num_val=1 rounds=2 sigma=1 'widths=[8,16]' voxel_size=0.2 crop_points=4000

clean:
	rm -rf $(VENV) .venv-mmdet3d build dist site *.egg-info
