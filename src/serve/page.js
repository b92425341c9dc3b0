// The operator's page: fills the frame from /api/state and /api/shots. Texts are set as text, never as markup.
"use strict";

const OFFLINE_MS = 800;
const SHAPES = {
  OFFLINE: { outline: "M15 15L85 85M85 15L15 85" },
  STARTING: { outline: "M50 10A40 40 0 0 1 90 50" },
  DISARMED: { outline: "M50 10A40 40 0 1 0 50 90A40 40 0 1 0 50 10" },
  FILLING: { outline: "M50 10A40 40 0 1 0 50 90A40 40 0 1 0 50 10" },
  READY: { outline: "M50 10A40 40 0 1 0 50 90A40 40 0 1 0 50 10", solid: "M50 28A22 22 0 1 0 50 72A22 22 0 1 0 50 28" },
  TRIGGERED: { solid: "M58 2L16 56H44L36 98L84 40H54Z" },
  MEASURING: { outline: "M22 10H78M22 90H78M28 10C28 40 46 44 46 50C46 56 28 60 28 90M72 10C72 40 54 44 54 50C54 56 72 60 72 90" },
  SAVED: { outline: "M14 54L40 80L88 22" },
  ENDED: { solid: "M18 18H82V82H18Z" },
  FAULT: { outline: "M50 12L92 86H8ZM50 40V58M50 72V72.5" },
};

const page = (() => {
  let name = sessionStorage.getItem("page");
  if (!name) {
    const numbers = crypto.getRandomValues(new Uint32Array(3));
    name = [...numbers].map((number) => number.toString(36)).join("");
    sessionStorage.setItem("page", name);
  }
  return name;
})();

const element = (id) => document.getElementById(id);
let heard = 0;
let state = null;
let revision = -1;

function make(tag, text, className) {
  const made = document.createElement(tag);
  if (text !== undefined && text !== null) made.textContent = text;
  if (className) made.className = className;
  return made;
}

function setText(id, text) {
  const target = element(id);
  if (target.textContent !== (text || "")) target.textContent = text || "";
}

// State

/** Returns the path of a pie that is filled clockwise from the top. */
function pie(share) {
  const angle = 2 * Math.PI * Math.min(share, 0.9999);
  const [x, y] = [50 + 30 * Math.sin(angle), 50 - 30 * Math.cos(angle)];
  return `M50 50V20A30 30 0 ${share > 0.5 ? 1 : 0} 1 ${x} ${y}Z`;
}

function showState(word, detail) {
  document.body.dataset.state = word;
  const texts = {
    OFFLINE: "NOT CONNECTED",
    FILLING: `FILLING ${state && state.percent} %`,
    SAVED: state && state.shot ? `SAVED shot ${state.shot}` : "SAVED",
  };
  setText("word", texts[word] || word);
  setText("detail", detail);
  const shape = SHAPES[word] || SHAPES.FAULT;
  element("outline").setAttribute("d", shape.outline || "");
  element("solid").setAttribute("d", word === "FILLING" ? pie(state.percent / 100) : shape.solid || "");
  document.title = `${texts[word] || word} – ${element("rig").textContent}`;
}

function showControls() {
  const isMine = state.holder === page || state.holder === null;
  for (const button of document.querySelectorAll("[data-command]")) {
    button.hidden = !isMine || !state.actions.includes(button.dataset.command);
  }
  element("take").hidden = isMine;
  document.dispatchEvent(new CustomEvent("control", { detail: isMine }));
  setText("holder", isMine ? "" : "Another page holds control.");
  const noTrigger = state.trigger === "off" ? "This rig has no trigger." : "No command is possible now.";
  setText("idle", state.actions.length === 0 ? noTrigger : "");
}

// Numbers

function showLast(last) {
  const place = [last.body, last.number === undefined ? null : `collision ${last.number + 1}`];
  setText("last-title", last.shot ? `Shot ${last.shot}` : "Last collision");
  setText("last-place", place.filter((part) => part !== null && part !== undefined).join(", "));
  setText("last-reason", last.reason && last.reason[0].toUpperCase() + last.reason.slice(1) + ".");
  element("numbers").replaceChildren(
    ...last.numbers.map((number) => {
      const entry = make("div");
      const value = make("dd", number.text === null ? "not measured" : number.text, number.text === null ? "none" : "");
      [value.dataset.column, value.dataset.value, value.dataset.sigma] = [number.column, number.value, number.sigma];
      entry.append(make("dt", number.label), value);
      if (number.text !== null) {
        value.append(make("small", ` ${number.unit}`));
        entry.append(make("p", `± ${number.sigma_text}`, "sigma"));
      }
      return entry;
    }),
  );
}

function showBar(id, text, share, kind) {
  const bar = element(`bar-${id}`);
  bar.querySelector(".value").textContent = text;
  bar.className = `bar ${kind}`;
  const meter = bar.querySelector("meter");
  if (meter) meter.value = share;
}

function size(bytes) {
  const power = Math.min(4, Math.floor(Math.log10(Math.max(bytes, 1)) / 3));
  return `${(bytes / 1000 ** power).toPrecision(3)} ${["B", "kB", "MB", "GB", "TB"][power]}`;
}

function showBars(bars) {
  const percent = Math.floor(100 * bars.ring_fraction);
  showBar("ring", bars.ring_s === null ? "not used" : `${percent} % of ${bars.ring_s} s`, bars.ring_fraction, bars.ring_s === null ? "quiet" : "");
  if (bars.disk_bytes === null) showBar("disk", "not used", 0, "quiet");
  else if (bars.disk_shots === null) showBar("disk", `${size(bars.disk_bytes)} free`, 1, "");
  else showBar("disk", `${bars.disk_shots} shots, ${size(bars.disk_bytes)}`, Math.min(1, bars.disk_shots / 100), bars.disk_shots < 10 ? "bad" : "");
  const lag = bars.lag_frames === null ? 0 : bars.lag_frames / Math.max(1, bars.lag_capacity_frames);
  const thinned = bars.measured_every > 1 ? `, 1 block of ${bars.measured_every} is measured` : "";
  showBar("lag", bars.lag_frames === null ? "not measured" : `${bars.lag_frames} of ${bars.lag_capacity_frames} frames${thinned}`, lag, lag > 0.5 || thinned ? "bad" : "");
  const lost = [["camera", bars.lost_camera], ["measured", bars.lost_measured], ["recorded", bars.lost_recorded]].filter((part) => part[1] > 0);
  showBar("lost", lost.length === 0 ? "0" : lost.map((part) => part.join(" ")).join(", "), 0, lost.length === 0 ? "quiet" : "bad");
  showBar("rate", bars.rate_hz === null ? "–" : `${Math.round(bars.rate_hz)} per second`, 0, "");
}

// Shots

function numberCell(number, index) {
  const cell = make("td", number.text === null || number.text === undefined ? "–" : number.text, number.outlier ? "outlier" : "");
  if (index > 1) cell.classList.add("minor");
  if (number.outlier) cell.title = "outlier";
  return cell;
}

function action(text, run) {
  const button = make("button", text);
  button.type = "button";
  button.addEventListener("click", run);
  return button;
}

function link(text, address, file) {
  const made = make("a", text);
  made.href = address;
  if (file) made.download = file;
  else made.target = "_blank";
  return made;
}

/** Returns the picture of a shot; a recording without frames has none. */
function thumbnail(address) {
  const image = make("img", null, "thumb");
  image.alt = "";
  image.loading = "lazy";
  image.onerror = () => image.remove();
  image.src = `${address}/picture`;
  return image;
}

function shotRow(shot) {
  const row = make("tr", null, shot.rejected === null ? "" : "rejected");
  row.dataset.name = shot.name;
  const time = shot.stamp_ns ? new Date(shot.stamp_ns / 1e6).toLocaleTimeString() : "";
  const address = `shots/${encodeURIComponent(shot.name)}`;
  const first = make("td", String(shot.number));
  first.append(thumbnail(address));
  row.append(first, make("td", time, "minor"), ...shot.numbers.map(numberCell));
  const last = make("td");
  last.append(link("Report", `${address}/report`), link("Download", address, shot.name));
  last.append(action("Replay", () => replay.open(shot, address)));
  if (shot.rejected === null) last.append(action("Reject", () => askReason(shot)));
  else last.append(action("Accept", () => send(`api/shots/${encodeURIComponent(shot.name)}/accept`)));
  const why = shot.rejected === null ? shot.reason : `rejected: ${shot.rejected}`;
  if (why) last.append(make("span", why, "why"));
  row.append(last);
  return row;
}

function showShots(list) {
  const heads = list.series.map((number, index) => {
    const head = make("th", number.label + (number.unit ? `, ${number.unit}` : ""));
    if (index > 1) head.classList.add("minor");
    return head;
  });
  element("shot-heads").replaceChildren(make("th", "Shot"), make("th", "Time", "minor"), ...heads, make("th"));
  const means = list.series.map((number, index) => {
    const cell = numberCell({ text: number.text }, index);
    if (number.sd_text) cell.append(make("small", ` ± ${number.sd_text}`));
    return cell;
  });
  const count = Math.max(0, ...list.series.map((number) => number.count));
  element("series").replaceChildren(make("td", "Mean ± sd"), make("td", `of ${count}`, "minor"), ...means, make("td"));
  const none = make("tr");
  none.append(make("td", "No shot yet.", "empty"));
  element("shot-rows").replaceChildren(...(list.shots.length === 0 ? [none] : list.shots.map(shotRow)));
}

async function readShots(wanted) {
  revision = wanted;
  try {
    showShots(await (await fetch("api/shots")).json());
  } catch {
    revision = -1;
  }
}

function askReason(shot) {
  const dialog = element("reject");
  setText("reject-number", String(shot.number));
  element("reason").value = "";
  dialog.returnValue = "";
  dialog.onclose = () => {
    const reason = element("reason").value;
    if (dialog.returnValue === "reject") send(`api/shots/${encodeURIComponent(shot.name)}/reject`, { reason });
  };
  dialog.showModal();
}

// Commands

async function send(address, body) {
  setText("answer", "");
  try {
    const options = { method: "POST", headers: { "x-ricochet-page": page }, body: body && JSON.stringify(body) };
    const answer = await (await fetch(address, options)).json();
    if (!answer.accepted) setText("answer", answer.answer);
  } catch {
    setText("answer", "The command did not reach the rig.");
  }
}

document.querySelectorAll("[data-command]").forEach((button) => {
  button.addEventListener("click", () => send(`api/${button.dataset.command}`));
});
element("take").addEventListener("click", () => send("api/control"));
document.addEventListener("keydown", (event) => {
  const isTyping = event.target.matches("input, textarea, select") || document.querySelector("dialog[open]");
  if (isTyping || event.repeat || event.ctrlKey || event.metaKey || event.altKey) return;
  const command = { a: "arm", d: "disarm", t: "trigger" }[event.key.toLowerCase()];
  if (command && !element(command).hidden) send(`api/${command}`);
});

// Connection

function receive(text) {
  heard = performance.now();
  state = JSON.parse(text);
  if (!state.state) return;
  showState(state.state, state.detail);
  showControls();
  showLast(state.last);
  showBars(state.bars);
  if (state.shots_revision !== revision) readShots(state.shots_revision);
}

function showOffline() {
  if (document.body.dataset.state === "OFFLINE" && element("word").textContent === "NOT CONNECTED") return;
  showState("OFFLINE", "The server does not answer. What is shown may be old.");
  document.querySelectorAll("[data-command]").forEach((button) => (button.hidden = true));
}

function connect() {
  const source = new EventSource(`api/state?page=${page}`);
  source.onmessage = (message) => receive(message.data);
  source.onerror = () => {
    showOffline();
    source.close();
    setTimeout(connect, 500);
  };
}

setInterval(() => {
  if (performance.now() - heard > OFFLINE_MS) showOffline();
}, 100);
connect();
