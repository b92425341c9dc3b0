//! The operator's page: its frame. `page.js` fills it, `picture.js` draws the live picture, `drawing.js` the shapes on it,
//! and `replay.js` shows the frames of a shot.

use maud::{DOCTYPE, Markup, html};

/// The commands, each with its key.
const COMMANDS: [(&str, &str); 3] = [("arm", "A"), ("trigger", "T"), ("disarm", "D")];

/// Returns the page of a rig as HTML.
pub(super) fn page_html(rig: &str) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (rig) " – ricochet" }
                link rel="icon" href="data:,";
                link rel="stylesheet" href="page.css";
                @for script in ["page.js", "picture.js", "drawing.js", "replay.js"] { script src=(script) defer {} }
            }
            body data-state="OFFLINE" {
                header id="state" {
                    svg id="shape" viewBox="0 0 100 100" aria-hidden="true" { path id="outline" {} path id="solid" {} }
                    div {
                        p id="word" role="status" aria-live="assertive" { "CONNECTING" }
                        p id="detail" {}
                    }
                    p id="rig" { (rig) }
                }
                main {
                    (live_picture())
                    (last_shot())
                    (sidebar())
                }
                (shot_table())
                (reject_dialog())
                (replay_dialog())
                noscript { "This page needs JavaScript. The state is also at /api/status." }
            }
        }
    };
    page.into_string() + "\n"
}

/// Returns the section of the live picture.
fn live_picture() -> Markup {
    html! {
        section id="live" aria-label="Live picture" {
            div id="stage" {
                canvas id="picture" width="512" height="512" {}
                svg id="drawing-layer" role="group" aria-label="Shape on the picture" {
                    path id="drawing-outline" {} path id="drawing-normal" {}
                }
            }
            (drawing_tools())
            p id="picture-note" {}
            label id="focus-label" { "Sharpness" meter id="focus" min="0" max="1" value="0" {} }
        }
    }
}

/// Returns the line under the live picture: the uncertainty of a speed now, and the tools that draw shapes.
fn drawing_tools() -> Markup {
    html! {
        div id="drawing" {
            p id="picture-now" {}
            p id="drawing-note" role="status" {}
            button type="button" id="drawing-start" disabled { "Draw" }
            div id="drawing-tools" hidden {
                select id="drawing-choice" aria-label="Shape to draw" {}
                input id="drawing-name" aria-label="Name of the new patch" maxlength="32" autocomplete="off" hidden;
                button type="button" id="drawing-clear" { "Start over" }
                button type="button" id="drawing-middle" { "In the middle" }
                button type="button" id="drawing-save" disabled { "Write to rig file" }
                button type="button" id="drawing-cancel" { "Cancel" }
            }
        }
    }
}

/// Returns the dialog with the frames of a shot along its velocity.
fn replay_dialog() -> Markup {
    html! {
        dialog id="replay" {
            form method="dialog" {
                h2 { span id="replay-title" {} button type="submit" { "Close" } }
            }
            img id="replay-picture" alt="Frame under the cursor";
            p id="replay-missing" role="status" {}
            svg id="replay-chart" aria-hidden="true" {}
            p id="replay-legend" { span class="normal" { "normal" } " and " span class="tangential" { "tangential" } " speed, m/s" }
            input type="range" id="replay-frame" step="1" aria-label="Frame";
            p id="replay-text" role="status" {}
        }
    }
}

/// Returns the section with the numbers of the last shot.
fn last_shot() -> Markup {
    html! {
        section id="last" aria-label="Last shot" {
            h2 { span id="last-title" { "Last shot" } span id="last-place" {} }
            p id="last-reason" {}
            dl id="numbers" {}
        }
    }
}

/// Returns the column of the commands and of the reserves: ring, disk, lag, lost frames, rate.
fn sidebar() -> Markup {
    html! {
        aside {
            section id="controls" aria-label="Commands" {
                @for (command, key) in COMMANDS {
                    button type="button" id=(command) data-command=(command) hidden {
                        (command.to_uppercase()) kbd { (key) }
                    }
                }
                p id="idle" {}
                p id="holder" {}
                button type="button" id="take" hidden { "Take control" }
                p id="answer" role="alert" {}
            }
            section id="bars" aria-label="Reserves" {
                @for (id, label) in [("ring", "Ring"), ("disk", "Disk"), ("lag", "Lag"), ("lost", "Lost frames"), ("rate", "Frames")] {
                    div class="bar" id=(format!("bar-{id}")) {
                        span class="label" { (label) }
                        span class="value" { "–" }
                        @if !matches!(id, "lost" | "rate") { meter min="0" max="1" value="0" aria-label=(label) {} }
                    }
                }
            }
        }
    }
}

/// Returns the table of the shots, whose rows the script fills in.
fn shot_table() -> Markup {
    html! {
        section id="shots" aria-label="Shots" {
            table {
                thead { tr id="shot-heads" { th { "Shot" } th { "Time" } } tr id="series" {} }
                tbody id="shot-rows" {}
            }
        }
    }
}

/// Returns the dialog that asks for the reason to reject a shot.
fn reject_dialog() -> Markup {
    html! {
        dialog id="reject" {
            form method="dialog" {
                h2 { "Reject shot " span id="reject-number" {} }
                p { "It no longer counts in the mean. Its file stays." }
                label { "Reason" input id="reason" name="reason" maxlength="200" required autocomplete="off"; }
                menu {
                    button type="submit" value="reject" { "Reject" }
                    button type="submit" value="cancel" formnovalidate { "Cancel" }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_asks_nothing_of_other_hosts_and_runs_nothing_that_stands_in_it() {
        let page = page_html("<b>&\"rig");
        assert!(page.contains("&lt;b&gt;&amp;") && !page.contains("<b>"));
        for foreign in ["http:", "https:", "//", "style=", "onclick", "<style"] {
            assert!(!page.contains(foreign), "{foreign}");
        }
    }
}
