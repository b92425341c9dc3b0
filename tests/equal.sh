#!/usr/bin/env bash
# The regression gate: every number that the program writes, against a list of checksums.
#
#     tests/equal.sh [PROGRAM]           compares (default: target/release/ricochet)
#     tests/equal.sh --write [PROGRAM]   makes the list again, after a change of numbers that is meant
#     tests/equal.sh --keep DIR PROGRAM  leaves the tables in DIR, to compare the numbers of two programs
#
# Covers `analyze` (with 1 and 3 workers), `export` of every topic and `field`, over `recordings/`, every built-in
# scenario and one imported film of each kind. Needs python3, and ffmpeg for the film in a video container.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
list=$here/golden/equal.txt
mode=compare
case "${1:-}" in
    --write) mode=write && shift ;;
    --keep) mode=keep && kept=$(mkdir -p "$2" && cd "$2" && pwd) && shift 2 ;;
esac
program=$(realpath "${1:-$here/../target/release/ricochet}")
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
mkdir tables films

# The tables of one film: NAME INPUT [options of analyze].
measure() {
    local name=$1 input=$2 workers
    shift 2
    for workers in 1 3; do
        # A film in which nothing can be measured has its tables as well.
        "$program" analyze "$input" "$@" --workers "$workers" --json -o "results-$workers.mcap" \
            > "answer-$workers.json" 2> messages.txt || [[ $? == 7 ]] || { cat messages.txt >&2; exit 1; }
    done
    sed -i 's/"results":"[^"]*",\?//' answer-*.json
    for topic in velocity field track impact events; do
        for workers in 1 3; do
            "$program" export "results-$workers.mcap" --topic $topic -o "tables/$name-$topic-$workers.csv"
        done
        cmp "tables/$name-$topic-1.csv" "tables/$name-$topic-3.csv"
        mv "tables/$name-$topic-1.csv" "tables/$name-$topic.csv"
        rm "tables/$name-$topic-3.csv"
    done
    cmp answer-1.json answer-3.json
    mv answer-1.json "tables/$name-analyze.json"
    rm -f answer-3.json results-1.mcap results-3.mcap
}

for recording in "$here"/../recordings/*.mcap; do
    measure "recording-$(basename "$recording" .mcap)" "$recording"
done

scenarios="lacrosse lacrosse-sphere tennis tennis-physical rod rod-ringing pair passing plane"
for pattern in a b c d e f; do scenarios+=" pattern-$pattern-I pattern-$pattern-II"; done
for scenario in $scenarios; do
    "$program" simulate "$scenario" -o film.mcap
    for topic in truth truth_impact; do
        "$program" export film.mcap --topic $topic -o "tables/$scenario-$topic.csv"
    done
    measure "$scenario" film.mcap
    rm film.mcap
done

"$program" simulate lacrosse -o lacrosse.mcap
for config in lacrosse patch; do
    measure "config-$config" lacrosse.mcap --config "$here/../config/$config.toml"
done

python3 "$here/equal/write_films.py" films
"$program" export lacrosse.mcap --topic frames --format ros2 -o films/foreign.mcap
rm lacrosse.mcap
rig=$here/equal/rig.toml
measure import-ros2 films/foreign.mcap --config "$here/../config/lacrosse.toml"
for kind in npy cine cihx tif; do
    measure "import-$kind" "films/film.$kind" --config "$rig" --fps 2000
done
"$program" analyze films/still_*.png --config "$rig" --fps 2000 --json -o stills.mcap > /dev/null
for topic in velocity field; do "$program" export stills.mcap --topic $topic -o "tables/import-png-$topic.csv"; done
if command -v ffmpeg > /dev/null; then
    ffmpeg -v error -framerate 2000 -i films/still_%03d.png -c:v ffv1 -pix_fmt gray films/film.mkv
    measure import-video films/film.mkv --config "$rig" --fps 2000
else
    echo "left out: import-video, since ffmpeg is not installed" >&2
fi

# field NAME [options]: the field of two neighbouring frames, its summary kept for a failure.
field() {
    local name=$1
    shift
    "$program" field films/still_010.png films/still_011.png "$@" -o "tables/field-$name.csv" 2> message.txt ||
        { cat message.txt >&2 && exit 1; }
}

field default
for method in spline-fft peak-gaussian peak-spline ic-gn; do field "$method" --method $method; done
for shape in translation rigid affine quadratic; do
    field "shape-$shape" --method ic-gn --shape $shape --subset 25 --step 9
done
for window in circle ring; do field "window-$window" --window $window --partial; done
field any-angle --start any-angle --interpolation bicubic --method ic-gn

if [[ $mode == keep ]]; then
    cp -r tables/. "$kept"
    exit
fi
(cd tables && sha256sum -- *) > sums.txt
if [[ $mode == write ]]; then
    cp sums.txt "$list"
    echo "wrote $(wc -l < "$list") checksums"
    exit
fi
expected() { if command -v ffmpeg > /dev/null; then cat "$list"; else grep -v ' import-video-' "$list"; fi; }
expected > expected.txt
if ! diff expected.txt sums.txt > difference.txt; then
    echo "results differ from $list:" >&2
    grep '^[<>]' difference.txt | cut -c69- | sort -u >&2
    exit 1
fi
echo "equal: $(wc -l < sums.txt) tables"
