#!/bin/sh
# A Ray cluster of a head and a second worker node on this machine, and a sweep through it.
#
#   tests/cluster/ray.sh check       leaves its runs in $OUT
#
# PYTHON is an interpreter with the project and its extra `ray`. The data: make ci-benchmark builds it.
set -eu
STATE=${STATE:-/tmp/two_node_ray}
OUT=${OUT:-$STATE/runs}
PYTHON=${PYTHON:-.venv/bin/python}
RAY="$(dirname "$PYTHON")/ray"
SWEEP=${SWEEP:-"experiment=ci method=identity,arap,elastic,sshade solver.max_iterations=100 ~bands"}
export RAY_USAGE_STATS_ENABLED=0

check() {
    rm -rf "$OUT"
    mkdir -p "$STATE"
    "$RAY" start --head --port=6399 --num-cpus=1 --include-dashboard=false --block > "$STATE/head.log" 2>&1 &
    nodes=$!
    trap 'kill $nodes; wait; rm -f /tmp/ray/ray_current_cluster' EXIT # which would send others there
    until "$RAY" status --address=127.0.0.1:6399 > /dev/null 2>&1; do sleep 1; done
    "$RAY" start --address=127.0.0.1:6399 --num-cpus=1 --block > "$STATE/worker.log" 2>&1 &
    nodes="$! $nodes"
    until "$RAY" status --address=127.0.0.1:6399 | grep -q '/2.0 CPU'; do sleep 1; done
    "$RAY" status --address=127.0.0.1:6399 | sed -n '/^Node status/,/^Total Usage/p'

    echo "== one after the other, in this process"
    # shellcheck disable=SC2086
    "$PYTHON" -m eval -m $SWEEP "paths.runs=$OUT/basic" > "$OUT.basic.log"
    tail -1 "$OUT.basic.log"
    echo "== through Ray"
    # shellcheck disable=SC2086
    "$PYTHON" -m eval -m $SWEEP "paths.runs=$OUT/ray" hydra/launcher=ray_cluster \
        hydra.launcher.ray.init.address=127.0.0.1:6399
    echo "== the same rows"
    "$PYTHON" -m eval.compare_rows "$OUT"/basic/* "$OUT"/ray/*
}

case ${1:-} in
check) check ;;
*) sed -n '2,/^set/s/^# \{0,1\}//p' "$0" && exit 2 ;;
esac
