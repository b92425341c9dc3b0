// The frames of a shot along its velocity: the cursor on the curves chooses the frame.
"use strict";

const replay = (() => {
  const SVG = "http://www.w3.org/2000/svg";
  const [WIDTH, HEIGHT] = [720, 220];
  const MARGIN = { left: 64, right: 12, top: 12, bottom: 30 };
  const dialog = element("replay");
  const chart = element("replay-chart");
  const slider = element("replay-frame");
  const image = element("replay-picture");
  let address = "";
  let curves = null;
  let cursor = null;
  /** The frame that is wanted next, while another one loads; null without one. */
  let waiting = null;
  let isLoading = false;

  function draw(tag, attributes, text) {
    const made = document.createElementNS(SVG, tag);
    Object.entries(attributes).forEach(([name, value]) => made.setAttribute(name, value));
    if (text) made.textContent = text;
    chart.append(made);
    return made;
  }

  /** Returns the time of a frame since the first one, s. */
  function timeOf(frame) {
    const { first_frame: first, last_frame: last, duration_s: duration } = curves;
    return last > first ? ((frame - first) * duration) / (last - first) : 0;
  }

  function xOf(frame) {
    const { first_frame: first, last_frame: last } = curves;
    return MARGIN.left + ((WIDTH - MARGIN.left - MARGIN.right) * (frame - first)) / Math.max(1, last - first);
  }

  function frameAt(x) {
    const { first_frame: first, last_frame: last } = curves;
    const share = (x - MARGIN.left) / (WIDTH - MARGIN.left - MARGIN.right);
    return Math.round(first + Math.min(Math.max(share, 0), 1) * (last - first));
  }

  /** Draws the normal and the tangential velocity of each body over the frames, with a scale. */
  function drawCurves() {
    chart.replaceChildren();
    const all = curves.bodies.flatMap((body) => body.rows);
    const speeds = all.flatMap((row) => [row[1], row[2]]).filter((speed) => speed !== null);
    const [low, high] = [Math.min(0, ...speeds), Math.max(0, ...speeds)];
    const span = high - low || 1;
    const yOf = (speed) => MARGIN.top + ((HEIGHT - MARGIN.top - MARGIN.bottom) * (high - speed)) / span;
    for (const speed of new Set([low, 0, high])) {
      draw("path", { d: `M${MARGIN.left} ${yOf(speed)}H${WIDTH - MARGIN.right}`, class: "rule" });
      draw("text", { x: MARGIN.left - 8, y: yOf(speed) + 5, "text-anchor": "end" }, speed.toPrecision(3));
    }
    draw("text", { x: MARGIN.left, y: HEIGHT - 8 }, "0 ms");
    const end = `${(1000 * curves.duration_s).toPrecision(4)} ms`;
    draw("text", { x: WIDTH - MARGIN.right, y: HEIGHT - 8, "text-anchor": "end" }, end);
    for (const body of curves.bodies) {
      for (const [column, kind] of [[1, "normal"], [2, "tangential"]]) {
        let isOpen = false;
        const steps = body.rows.map((row) => {
          const step = row[column] === null ? "" : `${isOpen ? "L" : "M"}${xOf(row[0]).toFixed(1)} ${yOf(row[column]).toFixed(1)}`;
          isOpen = row[column] !== null;
          return step;
        });
        draw("path", { d: steps.join(""), class: kind });
      }
    }
    cursor = draw("path", { class: "cursor" });
  }

  function describe(frame) {
    const speed = (value) => (value === null || value === undefined ? "–" : `${value.toFixed(3)} m/s`);
    const parts = curves.bodies.map((body) => {
      const row = body.rows.find((candidate) => candidate[0] >= frame);
      const isHere = row && row[0] - frame < curves.row_frames;
      return `${body.name}: normal ${speed(isHere ? row[1] : null)}, tangential ${speed(isHere ? row[2] : null)}`;
    });
    return [`frame ${frame}, ${(1000 * timeOf(frame)).toFixed(3)} ms`, ...parts].join(" – ");
  }

  /** Loads a frame, and after it the one that is wanted by then. */
  function load(frame) {
    if (isLoading) {
      waiting = frame;
      return;
    }
    isLoading = true;
    const loaded = new Image();
    const next = () => {
      isLoading = false;
      if (waiting !== null) {
        const wanted = waiting;
        waiting = null;
        load(wanted);
      }
    };
    loaded.onload = () => {
      image.src = loaded.src;
      image.dataset.frame = frame;
      setText("replay-missing", "");
      next();
    };
    loaded.onerror = () => {
      setText("replay-missing", `Frame ${frame} is not in the recording.`);
      next();
    };
    loaded.src = `${address}/frames/${frame}`;
  }

  function show(frame) {
    slider.value = frame;
    cursor.setAttribute("d", `M${xOf(frame)} ${MARGIN.top}V${HEIGHT - MARGIN.bottom}`);
    setText("replay-text", describe(frame));
    load(frame);
  }

  async function open(shot, at) {
    address = at;
    setText("replay-title", `Shot ${shot.number}`);
    try {
      const response = await fetch(`${at}/velocity`);
      if (!response.ok) throw new Error(await response.text());
      curves = await response.json();
    } catch (error) {
      setText("answer", error.message);
      return;
    }
    [slider.min, slider.max] = [curves.first_frame, curves.last_frame];
    image.removeAttribute("src");
    waiting = null;
    drawCurves();
    dialog.showModal();
    show(curves.first_frame);
  }

  function follow(event) {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(chart.getScreenCTM().inverse());
    show(frameAt(at.x));
  }

  chart.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
  chart.addEventListener("pointermove", follow);
  chart.addEventListener("pointerdown", follow);
  slider.addEventListener("input", () => show(Number(slider.value)));
  return { open };
})();
