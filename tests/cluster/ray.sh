#!/bin/sh
# A Ray cluster of a head and a second worker node on this machine, and a sweep through it.
#
#   tests/cluster/ray.sh check       leaves its runs in $OUT
#
# PYTHON is an interpreter with the project and its extra `ray`. The data: sshade-eval check builds it.
set -eu
STATE=${STATE:-/tmp/two_node_ray}
OUT=${OUT:-$STATE/runs}
PYTHON=${PYTHON:-.venv/bin/python}
RAY="$(dirname "$PYTHON")/ray"
SWEEP=${SWEEP:-"run.experiment=ci dataset.root=out/check/body_5k pose=1,2 method=identity,arap,elastic,paper
  proxy.vertices=1000 solver.max_iterations=100"}
export RAY_USAGE_STATS_ENABLED=0

node() { # a log, then options; each has a session of its own, so that its daemons end with it
    log=$1
    shift
    setsid "$RAY" start --num-cpus=1 --block "$@" > "$STATE/$log" 2>&1 &
    nodes="$! $nodes"
}

stop() {
    # shellcheck disable=SC2086
    kill $nodes 2> /dev/null || true
    wait
    for one in $nodes; do kill -- "-$one" 2> /dev/null || true; done # what a node that failed left
    rm -f /tmp/ray/ray_current_cluster # which would send others there
}

wait_for() { # a text in the status of the cluster, as long as the nodes live
    until "$RAY" status --address=127.0.0.1:6399 2> /dev/null | grep -q "$1"; do
        for one in $nodes; do
            kill -0 "$one" 2> /dev/null || { tail -n 5 "$STATE"/*.log && exit 1; }
        done
        sleep 1
    done
}

check() {
    rm -rf "$OUT"
    mkdir -p "$STATE"
    rm -f "$STATE"/*.log
    # Some of Ray's commands ask for a token where the user has one, others do not: this cluster has its own.
    (umask 077 && od -An -N32 -tx1 /dev/urandom | tr -d ' \n' > "$STATE/token")
    export RAY_AUTH_MODE=token RAY_AUTH_TOKEN_PATH="$STATE/token"
    nodes=
    trap stop EXIT
    trap 'exit 1' INT TERM
    node head.log --head --port=6399 --include-dashboard=false
    wait_for '/1.0 CPU'
    node worker.log --address=127.0.0.1:6399
    wait_for '/2.0 CPU'
    "$RAY" status --address=127.0.0.1:6399 | sed -n '/^Node status/,/^Total Usage/p'

    echo "== one after the other, in this process"
    # shellcheck disable=SC2086
    "$PYTHON" -m eval run -m $SWEEP "paths.runs=$OUT/basic" > "$OUT.basic.log"
    tail -1 "$OUT.basic.log"
    echo "== through Ray"
    # shellcheck disable=SC2086
    "$PYTHON" -m eval run -m $SWEEP "paths.runs=$OUT/ray" hydra/launcher=ray \
        hydra.launcher.ray.init.address=127.0.0.1:6399 +hydra.launcher.ray.init.object_store_memory=null
    echo "== the same rows"
    "$PYTHON" "$(dirname "$0")/same_rows.py" "$OUT"/basic/* "$OUT"/ray/*
}

case ${1:-} in
check) check ;;
*) sed -n '2,/^set/s/^# \{0,1\}//p' "$0" && exit 2 ;;
esac
