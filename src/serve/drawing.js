// Shapes on the live picture: drawn with mouse, touch or keys, and written to the rig file. Coordinates are px of the frame.
"use strict";

const drawing = (() => {
  const HANDLE_PX = 11;
  const SVG = "http://www.w3.org/2000/svg";
  const layer = element("drawing-layer");
  const outline = element("drawing-outline");
  const normal = element("drawing-normal");
  const picture = element("picture");
  const choice = element("drawing-choice");
  /** The name of a new patch. */
  const name = element("drawing-name");
  let revision = "";
  let shapes = [];
  /** The shape that is drawn, with `points` in px; null without one. */
  let draft = null;
  let dragged = -1;

  const isPair = () => ["trigger-region", "search-region", "edge"].includes(draft.shape);
  const isRegion = () => isPair() && draft.shape !== "edge";

  function label({ shape, body, place, points_px: points }) {
    const texts = {
      "trigger-region": "Trigger region",
      "search-region": `Search region of ${body}`,
      polygon: `Patch ${body}`,
      mask: `Mask ${place + 1} in ${body}`,
      "new-patch": "New patch",
      edge: "Edge of the surface",
    };
    return texts[shape] + (points.length === 0 && shape !== "new-patch" ? " (new)" : "");
  }

  function frameSize() {
    return [Number(picture.dataset.frameWidth) || 0, Number(picture.dataset.frameHeight) || 0];
  }

  function clamp([x, y]) {
    const [width, height] = frameSize();
    return [Math.min(Math.max(x, 0), width - 1), Math.min(Math.max(y, 0), height - 1)];
  }

  /** Rounds a point to what the rig file keeps. */
  function rounded(point) {
    const step = isRegion() ? 1 : 0.1;
    return clamp(point).map((x) => Number((Math.round(x / step) * step).toFixed(1)));
  }

  /** Returns the point of the frame under a pointer. */
  function pointAt(event) {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(layer.getScreenCTM().inverse());
    return clamp([at.x, at.y]);
  }

  // Drawing

  function handle(index) {
    const made = document.createElementNS(SVG, "circle");
    made.setAttribute("tabindex", "0");
    made.setAttribute("role", "button");
    made.dataset.index = index;
    layer.append(made);
    return made;
  }

  function path(points) {
    if (isRegion() && points.length === 2) {
      const [xs, ys] = [0, 1].map((axis) => points.map((point) => Math.round(point[axis])));
      const [left, right] = [Math.min(...xs) - 0.5, Math.max(...xs) + 0.5];
      const [top, bottom] = [Math.min(...ys) - 0.5, Math.max(...ys) + 0.5];
      return `M${left} ${top}H${right}V${bottom}H${left}Z`;
    }
    return points.length === 0 ? "" : `M${points.map((point) => point.join(" ")).join("L")}${isPair() ? "" : "Z"}`;
  }

  /** Draws the outward normal of an edge, from its middle. */
  function normalPath([from, to], unit) {
    const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    const length = Math.hypot(dx, dy) || 1;
    const [nx, ny] = [dy / length, -dx / length];
    const [x, y] = [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2];
    const [tipX, tipY] = [x + 30 * unit * nx, y + 30 * unit * ny];
    const side = (turn) => `${tipX - 8 * unit * (nx + turn * ny)} ${tipY - 8 * unit * (ny - turn * nx)}`;
    return `M${x} ${y}L${tipX} ${tipY}M${side(1)}L${tipX} ${tipY}L${side(-1)}`;
  }

  function render() {
    const [width, height] = frameSize();
    // Pixel (0, 0) is the centre of the first one.
    layer.setAttribute("viewBox", `-0.5 -0.5 ${picture.dataset.shownWidth || width} ${picture.dataset.shownHeight || height}`);
    const points = draft ? draft.points : [];
    const matrix = layer.getScreenCTM();
    const unit = matrix && matrix.a > 0 ? 1 / matrix.a : 1;
    outline.setAttribute("d", draft ? path(points) : "");
    normal.setAttribute("d", draft && draft.shape === "edge" && points.length === 2 ? normalPath(points, unit) : "");
    const handles = [...layer.querySelectorAll("circle")];
    handles.slice(points.length).forEach((old) => old.remove());
    points.forEach((point, index) => {
      const made = handles[index] || handle(index);
      made.setAttribute("cx", point[0]);
      made.setAttribute("cy", point[1]);
      made.setAttribute("r", HANDLE_PX * unit);
      made.setAttribute("aria-label", `Point ${index + 1} at ${rounded(point).join(", ")} px; arrow keys move it`);
    });
    element("drawing-save").disabled = !draft || (isPair() ? points.length !== 2 : points.length < 3);
  }

  // Pointer and keys

  layer.addEventListener("pointerdown", (event) => {
    if (!draft || event.button !== 0) return;
    event.preventDefault();
    layer.setPointerCapture(event.pointerId);
    const point = pointAt(event);
    const index = event.target.dataset.index;
    if (index !== undefined) {
      dragged = Number(index);
      event.target.focus();
    } else if (isPair()) {
      draft.points = [point, [...point]];
      dragged = 1;
    } else {
      draft.points.push(point);
      dragged = draft.points.length - 1;
    }
    render();
  });

  layer.addEventListener("pointermove", (event) => {
    if (!draft || dragged < 0) return;
    draft.points[dragged] = pointAt(event);
    render();
  });

  for (const kind of ["pointerup", "pointercancel"]) {
    layer.addEventListener(kind, () => {
      dragged = -1;
    });
  }

  const MOVES = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

  layer.addEventListener("keydown", (event) => {
    const index = Number(event.target.dataset.index);
    if (!draft || Number.isNaN(index)) return;
    const points = draft.points;
    const move = MOVES[event.key];
    if (move) {
      const step = event.shiftKey ? 10 : 1;
      points[index] = clamp([points[index][0] + step * move[0], points[index][1] + step * move[1]]);
    } else if (!isPair() && ["Delete", "Backspace"].includes(event.key) && points.length > 3) {
      points.splice(index, 1);
    } else if (!isPair() && event.key === "Enter") {
      const next = points[(index + 1) % points.length];
      points.splice(index + 1, 0, points[index].map((x, axis) => (x + next[axis]) / 2));
    } else {
      return;
    }
    event.preventDefault();
    render();
  });

  // The way to the rig file

  function note(text) {
    setText("drawing-note", text);
  }

  /** Returns a first shape in the middle of the frame, for those who draw with keys. */
  function middle() {
    const [width, height] = frameSize();
    const at = (x, y) => [x * width, y * height];
    if (draft.shape === "edge") return [at(0.2, 0.8), at(0.8, 0.8)];
    if (isPair()) return [at(0.25, 0.25), at(0.75, 0.75)];
    return [at(0.35, 0.35), at(0.65, 0.35), at(0.65, 0.65), at(0.35, 0.65)];
  }

  function choose(index) {
    const chosen = shapes[index];
    draft = chosen ? { ...chosen, points: chosen.points_px.map((point) => [...point]) } : null;
    name.hidden = !draft || draft.shape !== "new-patch";
    if (!name.hidden) name.value = draft.body;
    if (draft) note(isPair() ? "Drag on the picture, or move the points." : "Click the corners one after the other, or move them.");
    render();
  }

  async function read() {
    const wanted = choice.value;
    const answer = await (await fetch("api/drawing")).json();
    if (!answer.shapes) {
      note(answer.answer);
      return false;
    }
    [revision, shapes] = [answer.revision, answer.shapes];
    choice.replaceChildren(
      ...shapes.map((shape, index) => {
        const option = make("option", label(shape));
        option.value = String(index);
        return option;
      }),
    );
    choice.value = wanted && Number(wanted) < shapes.length ? wanted : "0";
    return true;
  }

  function setOpen(isOpen) {
    layer.classList.toggle("open", isOpen);
    element("drawing-tools").hidden = !isOpen;
    element("drawing-start").hidden = isOpen;
    if (!isOpen) {
      draft = null;
      render();
    }
  }

  async function start() {
    if (frameSize()[0] === 0) {
      note("There is no picture to draw on yet.");
      return;
    }
    note("");
    try {
      if (!(await read())) return;
    } catch {
      note("The server does not answer.");
      return;
    }
    setOpen(true);
    choose(Number(choice.value));
    choice.focus();
  }

  async function save() {
    const points = draft.points.map(rounded);
    const { shape, place } = draft;
    const body = name.hidden ? draft.body : name.value.trim();
    const options = {
      method: "POST",
      headers: { "x-ricochet-page": page },
      body: JSON.stringify({ revision, shape, body, place, points_px: points }),
    };
    try {
      const response = await fetch("api/drawing", options);
      const answer = await response.json();
      // Of a file that has changed, the shapes are read again, and the drawing stays.
      if (answer.accepted) setOpen(false);
      else if (response.status === 409) await read();
      note(answer.answer);
    } catch {
      note("The shape did not reach the server.");
    }
  }

  element("drawing-start").addEventListener("click", start);
  element("drawing-save").addEventListener("click", save);
  element("drawing-clear").addEventListener("click", () => {
    draft.points = [];
    render();
  });
  element("drawing-middle").addEventListener("click", () => {
    draft.points = middle();
    render();
    layer.querySelector("circle").focus();
  });
  element("drawing-cancel").addEventListener("click", () => {
    setOpen(false);
    note("");
  });
  choice.addEventListener("change", () => choose(Number(choice.value)));
  addEventListener("resize", render);
  new ResizeObserver(render).observe(layer);

  /** Only the page that holds control can draw. */
  function setControl(isMine) {
    element("drawing-start").disabled = !isMine;
    if (!isMine && draft) {
      setOpen(false);
      note("Another page has taken control.");
    }
  }
  document.addEventListener("control", (event) => setControl(event.detail));
  return { render };
})();
