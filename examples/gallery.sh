#!/usr/bin/env bash
# Makes a gallery in a new folder: six small films, their measurements, their reports as pages, and a picture of each.
#
#     examples/gallery.sh gallery
#
# Every film is simulated, so that its recording holds the true values too. The figures of the README, which the demo
# draws, are there as well. RICOCHET names the program, if it is not on the path.
set -euo pipefail
folder=${1:?usage: examples/gallery.sh FOLDER}
program=${RICOCHET:-ricochet}
config=$(cd "$(dirname "${BASH_SOURCE[0]}")/../config" && pwd)
mkdir "$folder"
cd "$folder"

# A ball of steel has no marks: light alone shapes it.
cat > steel.toml <<'SCENARIO'
name = "steel"

[camera]
width_px = 192
height_px = 160
frame_rate_hz = 10000.0
exposure_us = 20.0
frames = 80
noise_dn = 2.0

[scale]
mm_per_px = 0.2

[body]
diameter_mm = 20.0
shape = "sphere"

[body.pattern]
area_min_px2 = 4.0
area_max_px2 = 9.0
coverage = 0.0

[shade]
ball = 0.6
speckle = 0.6
ground = 0.12

[light]
side = 0.2
side_angle_deg = 60.0

[occluder]
shade = 0.4

[motion]
kind = "impact"
contact_start_s = 2e-3
contact_center_px = [95.3, 84.6]
vn_m_s = -1.5
vt_m_s = 0.0
omega_rad_s = 0.0
gravity_m_s2 = [0.0, -9.81]
mass_kg = 0.033
inertia_factor = 0.4

[motion.law]
kind = "kelvin-voigt"
stiffness_n_m = 6.0e4
damping_n_s_m = 6.0
SCENARIO

cat > steel-rig.toml <<'RIG'
[rig]
name = "steel"

[scale]
mm_per_px = 0.2

[surface]
angle_deg = 0

[[body]]
name = "ball"
kind = "ball"
diameter_mm = 20
RIG

gallery() { # NAME FRAME SCENARIO [RIG FILE]
    "$program" simulate "$3" -o "$1-film.mcap"
    "$program" analyze "$1-film.mcap" ${4:+--config "$4"} -o "$1.mcap"
    "$program" report "$1.mcap" --film "$1-film.mcap" -o "$1.html"
    # The displacements of one frame.
    "$program" export "$1.mcap" --film "$1-film.mcap" --topic field --format png -o "$1-frames"
    mv "$1-frames/field_$2.png" "$1.png"
    rm -r "$1-frames"
}

gallery rod 000036 rod
gallery tennis 000036 tennis
gallery lacrosse 000020 lacrosse
gallery pair 000036 pair
gallery patch 000036 lacrosse "$config/patch.toml"
gallery steel 000010 steel.toml steel-rig.toml

"$program" demo lacrosse -o demo
mv demo/*-fig18-field.svg impact-field.svg
mv demo/*-fig20-velocity.svg impact-velocity.svg
rm -r demo
