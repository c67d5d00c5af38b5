#!/bin/sh
# Runs the examples of docs/cluster.md, as the page has them, in an empty folder: the Snakemake
# workflow, a second time after a change of the manifest, and the script of the job array with
# Slurm's variables. The results must be the same files. Another library reads the batch's card.
set -eu
cd "$(dirname "$0")/../.."

program=$(scripts/build.sh)
snakemake=$PWD/out/snakemake/bin/snakemake
croissant=$PWD/out/interop/bin/python
page=$PWD/docs/cluster.md
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
mkdir "$folder/bin"
ln -s "$program" "$folder/bin/sonoweave"
PATH=$folder/bin:$PATH
cd "$folder"

# Prints the block of this language.
block() { awk -v begin="\`\`\`$1" '$0 == begin { inside = 1; next } /^```/ { inside = 0 } inside' "$page"; }
# Prints the hashes of all results.
hashes() { (cd "$1/sweeps" && find . -name 'volume*' -type f | xargs sha256sum | LC_ALL=C sort); }
# Prints the number of tries.
tries() { find run/attempts -name '*.json' | wc -l; }
fail() {
    echo "batch: $1" >&2
    exit 1
}

block python >Snakefile
block sh >array.sh
[ -s Snakefile ] && [ -s array.sh ] || fail "docs/cluster.md has no such blocks"
echo "id,recording,settings" >manifest.csv
for seed in 1 2 3 4 5; do
    sonoweave phantom -o s$seed.mha --frames 10 --image-size 40x30 --pixel 0.5 --gap 0.5 --seed $seed -q >/dev/null
    echo "s$seed,s$seed.mha,--clip none" >>manifest.csv
done
export XDG_CACHE_HOME="$folder/cache"
# Parts share a folder whose files are not Snakemake's: nothing waits for them.
"$snakemake" --cores 2 --quiet
grep -q '"whole": 5' verified.json || fail "the workflow has not reconstructed all sweeps"
[ "$(tries)" -eq 5 ] || fail "a sweep was tried twice"

# One changed row: one try more.
sed -i 's/^s3,.*/s3,s3.mha,--clip none --spacing 0.7/' manifest.csv
"$snakemake" --cores 2 --quiet
[ "$(tries)" -eq 6 ] || fail "$(tries) tries instead of 6 after a change of one row"
sonoweave batch status run | grep -q '5 of 5 sweeps are done' || fail "the changed sweep is not done"

# The same manifest by the job array, into a folder of its own.
hashes run >workflow.txt
mv run workflow
sonoweave batch plan manifest.csv -o run >/dev/null
for part in 1 2 3; do
    SLURM_ARRAY_TASK_ID=$part SLURM_ARRAY_TASK_COUNT=3 SLURM_CPUS_PER_TASK=1 sh array.sh >/dev/null
done
hashes run >array.txt
[ "$(wc -l <array.txt)" -eq 5 ] || fail "the array has not reconstructed all sweeps"
# The workflow's folder has the earlier files of the changed row, too.
[ -z "$(LC_ALL=C comm -23 array.txt workflow.txt)" ] || fail "the array's files differ from the workflow's"
# A card of the batch, by the reference library of Croissant.
sonoweave batch card run -o card --license CC0-1.0 >/dev/null
"$croissant" - <<'END'
import mlcroissant

card = mlcroissant.Dataset("card/croissant.json")
assert not card.metadata.ctx.issues.errors
sweeps = [{key.split("/")[1]: value for key, value in row.items()} for row in card.records("sweeps")]
assert [(row["sweep"], row["frames"]) for row in sweeps] == [(f"s{n}".encode(), 10) for n in range(1, 6)], sweeps
assert [row["participants/frames"] for row in card.records("participants")] == [50]
END
echo "batch: the examples of docs/cluster.md run, and give the same files"
