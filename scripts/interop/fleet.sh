#!/bin/sh
# Tests the files for a fleet of bedsides (packaging/fleet) by Debian's Prometheus: promtool accepts
# them, and runs their cases. A real server then scrapes ten sessions at virtual bedsides on
# loopback, each with its own token, two of them with TLS, and receives the samples of an agent.
# scripts/interop/fleet.py describes what must be there.
#
# `make interop` installs Prometheus first. Nothing is left running; the files stay in out/fleet.
set -eu
cd "$(dirname "$0")/../.."

program=$(scripts/build.sh)
place=out/fleet
rm -rf "$place"
mkdir -p "$place"
place=$(cd "$place" && pwd)
cp -r packaging/fleet "$place/files"
cd "$place"

# With the files that the configurations name, promtool checks these, too.
: >files/remote-write.password
for name in one two; do
    (umask 077 && openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 2 -subj "/CN=$name" \
        -addext "subjectAltName=DNS:$name.local,IP:127.0.0.1" -addext "basicConstraints=critical,CA:FALSE" \
        -keyout "$name.key" -out "$name.crt") 2>openssl.log
done
cat one.crt two.crt >files/sonoweave-ca.crt
cp files/sonoweave-ca.crt files/prometheus-ca.crt
openssl rand -hex 32 >files/sonoweave.token

promtool check config files/prometheus.yml
promtool check config --agent files/agent.yml
promtool test rules files/rules_test.yml

# The metrics of a batch.
echo "id,recording,settings" >manifest.csv
echo "one,one.mha,--clip none" >>manifest.csv
{
    "$program" phantom -o one.mha --frames 3 --image-size 40x30 --pixel 0.5 --gap 0.5 -q
    "$program" batch plan manifest.csv -o run
    "$program" batch run run -q
    "$program" batch status run --prometheus night.prom
} >batch.log 2>&1 || {
    cat batch.log >&2
    exit 1
}
promtool check metrics <night.prom
grep -qF 'sonoweave_batch_sweeps{batch="night",state="done"} 1' night.prom

exec python3 "$OLDPWD/scripts/interop/fleet.py" "$program" "$place"
