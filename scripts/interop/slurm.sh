#!/bin/bash
# Runs a batch by Debian's Slurm, all of it on this machine: by the job array of docs/cluster.md,
# and by the Python package's `--cluster slurm`, two of whose jobs are lost on the way. Both must
# give the same files. A job that Slurm refuses ends the package's command.
#
#   scripts/interop/slurm.sh PYTHON PROGRAM
#
# PYTHON is an environment's interpreter with the package, PROGRAM is sonoweave.
set -euo pipefail
cd "$(dirname "$0")/../.."

python=$1 program=$2
page=$PWD/docs/cluster.md
folder=$(mktemp -d)
daemons=()
end() {
    [ ${#daemons[@]} -eq 0 ] || kill "${daemons[@]}" 2>/dev/null || true
    wait
    rm -rf "$folder"
}
trap end EXIT
fail() {
    tail -n 20 "$folder"/slurm*.log >&2 || true
    echo "slurm: $1" >&2
    exit 1
}
mkdir "$folder/bin" "$folder/state" "$folder/spool"
ln -s "$program" "$folder/bin/sonoweave"
PATH=$folder/bin:/usr/sbin:$PATH
cd "$folder"

# Two ports that nothing uses.
read -r control node < <("$python" -c 'import socket
both = [socket.socket() for _ in range(2)]
for one in both: one.bind(("127.0.0.1", 0))
print(*(one.getsockname()[1] for one in both))')
host=$(hostname -s)
export SLURM_CONF=$folder/slurm.conf
cat >slurm.conf <<EOF
ClusterName=one
SlurmctldHost=$host(127.0.0.1)
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
AuthType=auth/none
CredType=cred/none
SlurmctldPort=$control
SlurmdPort=$node
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
ReturnToService=2
MailProg=/bin/true
SlurmdParameters=config_overrides
NodeName=$host NodeAddr=127.0.0.1 CPUs=2 RealMemory=4000 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES State=UP
EOF
slurmctld -D >slurmctld.log 2>&1 &
daemons+=($!)
slurmd -D -N "$host" >slurmd.log 2>&1 &
daemons+=($!)
# until COMMAND…: waits for a command that succeeds.
until_true() {
    local tries=0
    until "$@"; do
        tries=$((tries + 1))
        [ $tries -lt 1200 ] || fail "waited in vain for: $*"
        sleep 0.1
    done
}
is_idle() { [ "$(sinfo -h -o %T 2>/dev/null)" = idle ]; }
until_true is_idle

awk '/^```sh/{ inside = 1; next } /^```/{ inside = 0 } inside' "$page" >array.sh
[ -s array.sh ] || fail "docs/cluster.md has no script of a job array"
sonoweave phantom -o sweep.mha --frames 10 --image-size 40x30 --pixel 0.5 --gap 0.5 -q >/dev/null
echo "id,recording,settings" >manifest.csv
for spacing in $(seq 201 320); do
    echo "s$spacing,sweep.mha,--clip none --spacing 0.$spacing" >>manifest.csv
done
count=$(($(wc -l <manifest.csv) - 1))
# Prints the hashes of a batch's volumes.
hashes() { (cd "$1/sweeps" && find . -name 'volume*' -type f | LC_ALL=C sort | xargs sha256sum); }

sonoweave batch plan manifest.csv -o run >/dev/null
sbatch --wait --array=1-3 --cpus-per-task=1 --mem=1G array.sh >/dev/null || fail "the job array has failed: $(cat slurm-*.out)"
hashes run >array.txt
[ "$(wc -l <array.txt)" -eq "$count" ] || fail "the array has not reconstructed all sweeps"
mv run array

mkdir dask
export DASK_CONFIG=$folder/dask
settings() { printf 'jobqueue:\n  slurm:\n    cores: 1\n    memory: %s\n    walltime: "00:30:00"\n    interface: lo\n' "$1" >dask/jobqueue.yaml; }
sonoweave batch plan manifest.csv -o run >/dev/null
by_slurm() { "$python" -m sonoweave.batch run run --cluster slurm --workers 2 --program "$folder/bin/sonoweave"; }
settings 400GiB
code=0
by_slurm >refused.txt 2>&1 || code=$?
[ "$code" -eq 3 ] || fail "a job of more memory than there is ended with $code: $(cat refused.txt)"
grep -q "Requested node configuration is not available; change cores" refused.txt || fail "$(cat refused.txt)"

settings 1GiB
by_slurm >ran.txt 2>&1 &
package=$!
daemons+=($package)
some_done() { [ "$(find run/sweeps -name done.json 2>/dev/null | wc -l)" -ge 3 ] || ! kill -0 $package 2>/dev/null; }
until_true some_done
# Both jobs are lost; others take their place.
squeue -h -o %i | xargs scancel
wait $package || fail "the package's run has failed: $(cat ran.txt)"
hashes run >dask.txt
cmp array.txt dask.txt || fail "the package's files differ from the array's"
jobs=$(find . -maxdepth 1 -name 'slurm-[0-9]*.out' ! -name '*_*' | wc -l)
[ "$jobs" -gt 2 ] || fail "all was done by $jobs jobs, before any was lost"
echo "slurm: $count sweeps by a job array, and by $jobs jobs of Dask, two of them cancelled: the same files"
