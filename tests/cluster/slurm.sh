#!/bin/sh
# A Slurm cluster of one node on this machine, and a sweep through it with a worker killed.
#
#   apt install slurm-wlm munge slurmdbd mariadb-server      (Debian; everything below as root)
#   tests/cluster/slurm.sh start           the daemons; their files are in $STATE
#   tests/cluster/slurm.sh check           the sweep; leaves its runs in $OUT
#   tests/cluster/slurm.sh stop
#
# PYTHON is an interpreter with the project and its extra `slurm`. The data: make ci-benchmark builds it.
set -eu
STATE=${STATE:-/tmp/one_node_slurm}
OUT=${OUT:-$STATE/runs}
PYTHON=${PYTHON:-.venv/bin/python}
SWEEP=${SWEEP:-"run.experiment=ci dataset.root=out/check/body_5k pose=1,2 method=identity,arap,elastic,paper
  proxy.vertices=1000 solver.max_iterations=100"}
export SLURM_CONF="$STATE/slurm.conf"

start() {
    mkdir -p "$STATE/spool" "$STATE/state" "$STATE/sql" /run/munge
    chown munge: /run/munge
    chmod 755 "$STATE"
    host=$(hostname -s)
    # What a job became is asked of sacct, which needs accounting, which needs a database.
    cat > "$STATE/slurmdbd.conf" <<EOF
AuthType=auth/munge
DbdHost=$host
DbdAddr=127.0.0.1
SlurmUser=root
StorageType=accounting_storage/mysql
StorageHost=localhost
StorageUser=root
StorageLoc=slurm
PidFile=$STATE/slurmdbd.pid
LogFile=$STATE/slurmdbd.log
EOF
    cat > "$SLURM_CONF" <<EOF
ClusterName=one
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
AuthType=auth/munge
AccountingStorageType=accounting_storage/slurmdbd
AccountingStorageHost=127.0.0.1
JobAcctGatherType=jobacct_gather/linux
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
ReturnToService=2
StateSaveLocation=$STATE/state
SlurmdSpoolDir=$STATE/spool
SlurmctldPidFile=$STATE/slurmctld.pid
SlurmdPidFile=$STATE/slurmd.pid
SlurmctldLogFile=$STATE/slurmctld.log
SlurmdLogFile=$STATE/slurmd.log
MailProg=/bin/true
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc) RealMemory=$(free -m | awk '/^Mem/ {print int($2 * 0.8)}')
PartitionName=all Nodes=$host Default=YES State=UP MaxTime=INFINITE
EOF
    chmod 600 "$STATE/slurmdbd.conf"
    mkdir -p /run/mysqld
    chown mysql: /run/mysqld "$STATE/sql"
    mariadb-install-db --user=mysql --datadir="$STATE/sql" > "$STATE/sql.log" 2>&1
    mariadbd --user=mysql --datadir="$STATE/sql" --skip-networking --pid-file="$STATE/sql/pid" >> "$STATE/sql.log" 2>&1 &
    until mariadb-admin ping > /dev/null 2>&1; do sleep 1; done
    runuser -u munge -- munged --pid-file=/run/munge/munged.pid
    slurmdbd
    sleep 3
    sacctmgr -i add cluster one > /dev/null || true
    slurmctld
    slurmd
    sleep 3
    sinfo
}

stop() {
    scontrol shutdown
    sleep 2
    kill "$(cat "$STATE/slurmdbd.pid")" "$(cat "$STATE/sql/pid")" "$(cat /run/munge/munged.pid)"
}

sweep() { # a folder, then more overrides
    folder=$1
    shift
    # shellcheck disable=SC2086
    "$PYTHON" -m eval run -m $SWEEP "paths.runs=$OUT/$folder" "$@"
}

check() {
    rm -rf "$OUT"
    slurm="hydra/launcher=slurm hydra.launcher.cpus_per_task=1 hydra.launcher.mem_gb=2 hydra.launcher.timeout_min=30"
    echo "== one after the other, in this process"
    sweep basic > "$OUT.basic.log"
    tail -1 "$OUT.basic.log"

    echo "== through Slurm, killing the worker of the third run"
    # shellcheck disable=SC2086
    sweep slurm $slurm > "$OUT.slurm.log" 2>&1 &
    main=$!
    worker=
    while [ -z "$worker" ]; do
        kill -0 $main
        sleep 1
        job=$(squeue -h -t R -o '%K %A' | awk '$1 == 2 {print $2}')
        [ -n "$job" ] || continue
        worker=$(scontrol listpids "$job" 2> /dev/null | awk 'NR > 1 && $1 > 0 {print $1}' | while read -r pid; do
            tr '\0' ' ' < "/proc/$pid/cmdline" | grep -q '^[^ ]*python[^ ]* .*-m submitit' && echo "$pid"
        done | tail -1)
    done
    squeue
    ps -o pid=,args= -p "$worker"
    kill -9 "$worker"
    code=0
    wait $main || code=$?
    cat "$OUT.slurm.log"
    echo "exit code $code"
    [ $code -eq 1 ]
    while [ -n "$(squeue -h)" ]; do sleep 1; done

    echo "== the same command again"
    # shellcheck disable=SC2086
    sweep slurm $slurm
    echo "== the same rows"
    "$PYTHON" "$(dirname "$0")/same_rows.py" "$OUT"/basic/* "$OUT"/slurm/*
}

case ${1:-} in
start | check | stop) "$1" ;;
*) sed -n '2,/^set/s/^# \{0,1\}//p' "$0" && exit 2 ;;
esac
