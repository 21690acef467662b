"use strict";
(() => {
  const $ = (id) => document.getElementById(id);
  document.documentElement.classList.add("ready");

  // Tables: what is ticked is shown.

  const filter = $("filter");
  const rows = [...document.querySelectorAll("#main tr[data-s]")];
  const inTables = rows.filter((row) => row.closest("#tables"));

  function unticked(name) {
    return new Set([...filter.querySelectorAll(`input[name=${name}]:not(:checked)`)].map((box) => box.value));
  }

  function applyFilter() {
    const strategies = unticked("strategy"), sizes = unticked("size");
    if (strategies.size) strategies.add("none"); // rows of what was never run are of no use to who looks for some
    for (const row of rows) {
      row.hidden = row.dataset.s.split(" ").some((one) => strategies.has(one)) || sizes.has(row.dataset.z);
    }
    document.querySelectorAll("#tables :is(th, td)[data-z]").forEach((cell) => { cell.hidden = sizes.has(cell.dataset.z); });
    const left = inTables.filter((row) => !row.hidden).length;
    $("shown").textContent = left === inTables.length ? "" : `${left} of ${inTables.length} rows are shown.`;
  }

  filter.addEventListener("change", applyFilter);
  filter.addEventListener("submit", (event) => event.preventDefault());
  filter.querySelectorAll("button").forEach((button) => button.addEventListener("click", () => {
    filter.querySelectorAll("input[name=strategy]").forEach((box) => { box.checked = button.dataset.set === "all"; });
    applyFilter();
  }));
  applyFilter(); // a browser may restore ticks of an earlier visit

  if (!$("replays")) return;

  // Replays: the format is that of explore_bench/report/packing.py and fine_replays.py.

  const { strategies, maps, trials, colors, coverage, start } = JSON.parse($("replays").textContent);
  const opened = new Map();

  async function open(trial) {
    if (!opened.has(trial)) opened.set(trial, inflate(trial.data).then(unpack));
    return opened.get(trial);
  }

  async function inflate(text) {
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  function unpack(bytes) {
    const length = new DataView(bytes.buffer, bytes.byteOffset).getUint32(0, true);
    const replay = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + length)));
    let place = 4 + length;
    const column = {};
    for (const { name, count, lag, scale } of replay.columns) {
      const whole = new Int32Array(count);
      for (let i = 0; i < count; i++) {
        let value = 0, shift = 0, byte;
        do {
          byte = bytes[place++];
          value |= (byte & 127) << shift;
          shift += 7;
        } while (byte & 128);
        whole[i] = ((value >>> 1) ^ -(value & 1)) + (lag && i >= lag ? whole[i - lag] : 0);
      }
      column[name] = scale === 1 ? whole : Float64Array.from(whole, (value) => value * scale);
    }
    const starts = (counts) => counts.reduce((sums, count) => [...sums, sums[sums.length - 1] + count], [0]);
    const end = column.x.length - 1;
    return { ...replay, column, end,
      candidateStarts: starts([...column.candidate_count]),
      landmarkStarts: starts([...column.landmark_count]) };
  }

  // Where the robot has a map finer than the grid of decisions: that map, and its way as it was estimated then.

  function fineAt(replay, k) {
    const c = replay.column, n = replay.fineCells;
    if (!replay.fine || replay.fine.at > k) {
      replay.fine = { at: -1, painted: -1, run: 0, pose: 0, cells: new Uint8Array(n * n), xs: [], ys: [],
        paper: Object.assign(document.createElement("canvas"), { width: n, height: n }) };
    }
    const fine = replay.fine;
    while (fine.at < k) {
      fine.at++;
      for (let i = 0, place = 0; i < c.fine_count[fine.at]; i++, fine.run++) {
        place += c.fine_gap[fine.run];
        fine.cells.fill(c.fine_class[fine.run], place, place += c.fine_length[fine.run]);
      }
      fine.xs.length = fine.ys.length = c.path_from[fine.at];
      while (fine.xs.length < c.path_count[fine.at]) {
        fine.xs.push(c.path_x[fine.pose]);
        fine.ys.push(c.path_y[fine.pose++]);
      }
    }
    if (fine.painted !== k) paint(fine, n);
    fine.painted = k;
    return fine;
  }

  function paint(fine, n) {
    const g = fine.paper.getContext("2d"), image = g.createImageData(n, n);
    const shades = [colors.unknown, colors.free, colors.occupied].map((color) => parseInt(color.slice(1), 16));
    for (let i = 0; i < n * n; i++) {
      const shade = shades[fine.cells[i]], at = 4 * ((n - 1 - Math.floor(i / n)) * n + i % n);
      image.data[at] = shade >> 16;
      image.data[at + 1] = shade >> 8 & 255;
      image.data[at + 2] = shade & 255;
      image.data[at + 3] = 255;
    }
    g.putImageData(image, 0, 0);
  }

  function decisionAt(replay, step) {
    const at = replay.column.decided_at;
    let index = 0;
    while (index + 1 < at.length && at[index + 1] <= step) index++;
    return index;
  }

  // Drawing. All of it is drawn on paper of one light colour, so that colours mean the same in the dark.

  function fit(canvas) {
    const ratio = Math.min(window.devicePixelRatio || 1, 3);
    const width = Math.max(1, Math.round(canvas.clientWidth * ratio)), height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    return [context, width / ratio, height / ratio];
  }

  function drawMap(canvas, replay, step, truth) {
    const [g, width] = fit(canvas);
    const view = { replay, step, truth, width, k: decisionAt(replay, step), scale: width / (replay.cells * replay.cellSize) };
    view.px = (x) => x * view.scale;
    view.py = (y) => width - y * view.scale;
    if (replay.fineCells) drawFine(g, view);
    else drawCells(g, view);
  }

  function drawFine(g, { replay, step, truth, width, k, px, py }) {
    const c = replay.column, fine = fineAt(replay, k), next = k + 1 < c.decided_at.length ? c.decided_at[k + 1] : step;
    g.imageSmoothingEnabled = false;
    g.drawImage(fine.paper, 0, 0, width, width);
    if (truth) {
      const wide = width / replay.wallCells;
      g.fillStyle = colors.truth;
      g.globalAlpha = 0.55;
      for (const cell of replay.obstacles) {
        g.fillRect((cell % replay.wallCells) * wide, width - (Math.floor(cell / replay.wallCells) + 1) * wide, wide, wide);
      }
      g.globalAlpha = 1;
    }
    const since = c.decided_at[k] + 1;
    way(g, [...fine.xs, ...c.x.subarray(since, step + 1)], [...fine.ys, ...c.y.subarray(since, step + 1)], px, py, colors.estimate, 2);
    if (truth) way(g, c.true_x.subarray(0, step + 1), c.true_y.subarray(0, step + 1), px, py, colors.truth, 0.8);
    for (let i = 0; i < c.loop_count[k]; i++) {
      const ends = [c.loop_earlier[i], c.loop_later[i]];
      way(g, ends.map((end) => fine.xs[end]), ends.map((end) => fine.ys[end]), px, py, colors.loop, 3);
    }
    g.setLineDash([5, 3]);
    way(g, c.x.subarray(step, next + 1), c.y.subarray(step, next + 1), px, py, colors.chosen, 1.8);
    g.setLineDash([]);
    const first = replay.candidateStarts[k];
    for (let i = 0; i < c.candidate_count[k]; i++) {
      const chosen = i === c.choice[k];
      g.fillStyle = chosen ? colors.chosen : colors.candidate;
      disc(g, px(c.candidate_x[first + i]), py(c.candidate_y[first + i]), chosen ? 6 : 4);
    }
    if (c.choice[k] < 0 && c.target_x[k] >= 0) {
      g.fillStyle = colors.chosen;
      disc(g, px(c.target_x[k]), py(c.target_y[k]), 6);
    }
    robot(g, px(c.x[step]), py(c.y[step]), -c.heading[step]);
  }

  function drawCells(g, { replay, step, truth, width, k, scale, px, py }) {
    const n = replay.cells, unit = width / n, c = replay.column, base = k * n * n;
    const column = (cell) => cell % n, row = (cell) => n - 1 - Math.floor(cell / n);

    g.fillStyle = colors.unknown;
    g.fillRect(0, 0, width, width);
    for (const [kind, color] of [[1, colors.free], [2, colors.occupied]]) {
      g.fillStyle = color;
      g.beginPath();
      for (let i = 0; i < n * n; i++) if (c.map[base + i] === kind) g.rect(column(i) * unit, row(i) * unit, unit, unit);
      g.fill();
    }
    g.strokeStyle = "rgba(0,0,0,.06)";
    g.lineWidth = 1;
    g.beginPath();
    for (let i = 1; i < n; i++) { g.moveTo(i * unit, 0); g.lineTo(i * unit, width); g.moveTo(0, i * unit); g.lineTo(width, i * unit); }
    g.stroke();

    if (truth) {
      g.strokeStyle = colors.truth;
      g.globalAlpha = 0.55;
      g.lineWidth = 1;
      g.setLineDash([3, 2]);
      const wide = width / replay.wallCells, inset = Math.min(1.5, wide / 4);
      for (const cell of replay.obstacles) {
        const left = (cell % replay.wallCells) * wide, top = width - (Math.floor(cell / replay.wallCells) + 1) * wide;
        g.strokeRect(left + inset, top + inset, wide - 2 * inset, wide - 2 * inset);
      }
      g.setLineDash([]);
      g.globalAlpha = 1;
    }

    g.strokeStyle = colors.ellipse;
    g.lineWidth = 0.9;
    g.beginPath();
    for (let i = 0; i < n * n; i++) {
      if (c.minor[base + i] > 0.97) continue;
      const x = (column(i) + 0.5) * unit, y = (row(i) + 0.5) * unit, a = c.major[base + i] * unit / 2, b = c.minor[base + i] * unit / 2;
      const turn = -c.angle[base + i];
      g.moveTo(x + a * Math.cos(turn), y + a * Math.sin(turn));
      g.ellipse(x, y, a, b, turn, 0, 2 * Math.PI);
    }
    g.stroke();

    const x = px(c.x[step]), y = py(c.y[step]);
    g.fillStyle = colors.range;
    g.globalAlpha = 0.28;
    disc(g, x, y, replay.range * scale);
    g.globalAlpha = 1;

    if (truth) way(g, c.true_x.subarray(0, step + 1), c.true_y.subarray(0, step + 1), px, py, colors.truth, 1);
    way(g, c.x.subarray(0, step + 1), c.y.subarray(0, step + 1), px, py, colors.estimate, 1.8);
    g.strokeStyle = colors.estimate;
    g.lineWidth = 1.1;
    for (let i = 0; i < 12; i++) {
      const at = Math.round(step * i / 11);
      g.beginPath();
      g.ellipse(px(c.x[at]), py(c.y[at]), c.pose_major[at] * scale, c.pose_minor[at] * scale, -c.pose_angle[at], 0, 2 * Math.PI);
      g.stroke();
    }

    if (truth) for (const [lx, ly] of replay.landmarks) cross(g, px(lx), py(ly), 6, colors.truth, 2.4);
    for (let i = replay.landmarkStarts[k]; i < replay.landmarkStarts[k + 1]; i++) {
      const lx = px(c.landmark_x[i]), ly = py(c.landmark_y[i]);
      cross(g, lx, ly, 6, colors.landmark, 2);
      g.strokeStyle = colors.landmark;
      g.lineWidth = 1.4;
      g.beginPath();
      g.ellipse(lx, ly, c.landmark_major[i] * scale, c.landmark_minor[i] * scale, -c.landmark_angle[i], 0, 2 * Math.PI);
      g.stroke();
    }

    const first = replay.candidateStarts[k];
    for (let i = 0; i < c.candidate_count[k]; i++) {
      const cell = c.candidates[first + i], chosen = i === c.choice[k];
      const cx = (column(cell) + 0.5) * unit, cy = (row(cell) + 0.5) * unit;
      g.fillStyle = chosen ? colors.chosen : colors.candidate;
      disc(g, cx, cy, chosen ? Math.min(7, unit / 3) : Math.min(4.5, unit / 5));
      if (chosen) towards(g, x, y, cx, cy);
    }
    if (c.choice[k] < 0 && c.target_x[k] >= 0) {
      const tx = px(c.target_x[k]), ty = py(c.target_y[k]);
      g.fillStyle = colors.chosen;
      disc(g, tx, ty, Math.min(7, unit / 3));
      towards(g, x, y, tx, ty);
    }
    robot(g, x, y, -c.heading[step]);
  }

  function towards(g, x, y, toX, toY) {
    g.strokeStyle = colors.chosen;
    g.lineWidth = 1.2;
    g.setLineDash([4, 4]);
    g.beginPath();
    g.moveTo(x, y);
    g.lineTo(toX, toY);
    g.stroke();
    g.setLineDash([]);
  }

  function disc(g, x, y, radius) {
    g.beginPath();
    g.arc(x, y, radius, 0, 2 * Math.PI);
    g.fill();
  }

  function cross(g, x, y, half, color, width) {
    g.strokeStyle = color;
    g.lineWidth = width;
    g.beginPath();
    g.moveTo(x - half, y); g.lineTo(x + half, y); g.moveTo(x, y - half); g.lineTo(x, y + half);
    g.stroke();
  }

  function way(g, xs, ys, px, py, color, width) {
    g.strokeStyle = color;
    g.lineWidth = width;
    g.lineJoin = "round";
    g.beginPath();
    for (let i = 0; i < xs.length; i++) g.lineTo(px(xs[i]), py(ys[i]));
    g.stroke();
  }

  function robot(g, x, y, turn) {
    g.save();
    g.translate(x, y);
    g.rotate(turn);
    g.beginPath();
    g.moveTo(9, 0); g.lineTo(-6, 6); g.lineTo(-3, 0); g.lineTo(-6, -6);
    g.closePath();
    g.fillStyle = colors.estimate;
    g.strokeStyle = "#fff";
    g.lineWidth = 1.4;
    g.stroke();
    g.fill();
    g.restore();
  }

  function niceTicks(top) {
    const raw = top / 4, power = 10 ** Math.floor(Math.log10(raw));
    const unit = [1, 2, 2.5, 5, 10].find((one) => one * power >= raw) * power;
    return Array.from({ length: Math.floor(top / unit + 1e-9) + 1 }, (_, i) => i * unit);
  }

  function topOf(name, shown, last) {
    if (name === "explored") return 1;
    let top = 0;
    for (const { replay } of shown) {
      const values = replay.column[name];
      const from = name === "exploration_efficiency" ? Math.min(Math.max(Math.floor(last / 10), 1), values.length - 1) : 0; // it starts at infinity
      for (let i = from; i < values.length; i++) top = Math.max(top, values[i]);
    }
    return top * 1.08 || 1;
  }

  function drawCurve(canvas, shown, step, last) {
    const name = canvas.dataset.curve;
    const [g, width, height] = fit(canvas);
    const left = 40, right = 46, above = 9, below = 20, top = topOf(name, shown, last);
    const px = (at) => left + at / Math.max(last, 1) * (width - left - right);
    const py = (value) => height - below - value / top * (height - above - below);
    g.font = "11px system-ui, sans-serif";
    g.textBaseline = "middle";
    g.fillStyle = "#666";
    g.strokeStyle = "rgba(0,0,0,.09)";
    g.lineWidth = 1;
    g.textAlign = "right";
    for (const tick of niceTicks(top)) {
      g.beginPath(); g.moveTo(left, py(tick)); g.lineTo(width - right, py(tick)); g.stroke();
      g.fillText(name === "explored" ? `${Math.round(100 * tick)} %` : String(+tick.toPrecision(3)), left - 4, py(tick));
    }
    if (name === "explored") {
      g.strokeStyle = "rgba(0,0,0,.35)"; g.setLineDash([2, 3]);
      g.beginPath(); g.moveTo(left, py(coverage)); g.lineTo(width - right, py(coverage)); g.stroke();
      g.setLineDash([]);
    }
    g.textAlign = "center";
    for (const tick of niceTicks(last)) g.fillText(String(Math.round(tick)), px(tick), height - below + 11);

    g.save();
    g.beginPath(); g.rect(left, 0, width - left - right, height - below + 1); g.clip();
    for (const { replay, strategy, dashed } of shown) {
      const values = replay.column[name], cells = name === "explored" ? replay.cells ** 2 : 1;
      g.strokeStyle = strategy.color;
      g.setLineDash(dashed ? [5, 3] : []);
      for (const [until, alpha, thick] of [[replay.end, 0.2, 1.2], [Math.min(step, replay.end), 1, 2]]) {
        g.globalAlpha = alpha;
        g.lineWidth = thick;
        g.beginPath();
        for (let i = name === "explored" ? 0 : 1; i <= until; i++) g.lineTo(px(i), py(values[i] / cells));
        g.stroke();
      }
      g.globalAlpha = 1;
      g.setLineDash([]);
    }
    g.restore();
    g.strokeStyle = "rgba(0,0,0,.45)"; g.lineWidth = 1;
    g.beginPath(); g.moveTo(px(step), above); g.lineTo(px(step), height - below); g.stroke();
    label(g, name, shown, step, width - right + 5, py, height - below);
  }

  function label(g, name, shown, step, x, py, floor) {
    const items = shown.map(({ replay, strategy }) => {
      const at = Math.min(step, replay.end), cells = name === "explored" ? replay.cells ** 2 : 1;
      const value = replay.column[name][at] / cells;
      const text = name !== "explored" && at === 0 ? "" : name === "explored" ? `${Math.round(100 * value)} %` : String(value.toFixed(2));
      return { text, color: strategy.color, y: Math.min(Math.max(py(value), 8), floor) };
    }).sort((a, b) => a.y - b.y);
    for (let i = 1; i < items.length; i++) items[i].y = Math.max(items[i].y, items[i - 1].y + 13);
    if (items.length) { const over = items[items.length - 1].y - floor; if (over > 0) items.forEach((item) => { item.y -= over; }); }
    g.textAlign = "left";
    for (const { text, color, y } of items) {
      g.fillStyle = color;
      if (text) { g.beginPath(); g.arc(x + 2, y, 3, 0, 7); g.fill(); }
      g.fillStyle = "#222";
      g.fillText(text, x + 8, y);
    }
  }

  // Picking a trial, or two on one world.

  const pick = { map: $("pick-map"), a: $("pick-a"), b: $("pick-b"), world: $("pick-world") };
  const stages = [...document.querySelectorAll(".stage")], curves = [...document.querySelectorAll(".curve")];
  const words = { example: "common example", best: "best η", median: "median η", worst: "worst η" };
  const state = { shown: [], step: 0, last: 0, playing: false, request: 0, clock: 0 };
  const unique = (values) => [...new Set(values)];
  const find = (strategy, map, world) => trials.find((one) => one.strategy === strategy && one.map === map && one.world === world);

  function fill(select, options, wanted) {
    select.replaceChildren(...options.map(([value, text]) => new Option(text, value)));
    if (options.some(([value]) => String(value) === String(wanted))) select.value = wanted;
  }

  function roles(trial, alone) {
    const own = trial.roles.filter((role) => role !== "example").map((role) => words[role]);
    return own.length ? own.join(", ") + (alone ? "" : ` of ${strategies[trial.strategy].label}`) : "";
  }

  let opening = start ?? null; // what is picked before anybody picks

  function offer() {
    const wanted = opening ?? { a: pick.a.value, b: pick.b.value };
    opening = null;
    const map = Number(pick.map.value);
    const here = unique(trials.filter((one) => one.map === map).map((one) => one.strategy)).sort((a, b) => a - b);
    fill(pick.a, here.map((one) => [one, strategies[one].label]), wanted.a);
    const a = Number(pick.a.value);
    const common = (b) => trials.some((one) => one.strategy === b && one.map === map && find(a, map, one.world));
    fill(pick.b, [["", "nothing"], ...here.filter((one) => one !== a && common(one)).map((one) => [one, strategies[one].label])], wanted.b);
    const b = pick.b.value === "" ? null : Number(pick.b.value);
    const worlds = trials.filter((one) => one.strategy === a && one.map === map && (b === null || find(b, map, one.world)));
    fill(pick.world, worlds.map((one) => {
      const parts = [one.roles.includes("example") ? words.example : "", roles(one, b === null), b === null ? "" : roles(find(b, map, one.world), false)];
      return [one.world, `World ${one.world} – ${parts.filter(Boolean).join(b === null ? ", " : "; ")}`];
    }), pick.world.value);
  }

  async function load() {
    offer();
    pause();
    const request = ++state.request, map = Number(pick.map.value), world = Number(pick.world.value);
    const picked = [pick.a.value, pick.b.value].filter((value) => value !== "").map((value) => find(Number(value), map, world));
    try {
      const replays = await Promise.all(picked.map(open));
      if (request !== state.request) return; // another was picked meanwhile
      state.shown = replays.map((replay, i) => ({ replay, trial: picked[i], strategy: strategies[picked[i].strategy],
        dashed: i > 0 && strategies[picked[i].strategy].color === strategies[picked[0].strategy].color }));
      $("trouble").hidden = true;
    } catch (error) {
      $("trouble").hidden = false;
      $("trouble").textContent = `This replay cannot be opened (${error.message}); a browser of 2023 or later is needed.`;
      return;
    }
    state.last = Math.max(...state.shown.map(({ replay }) => replay.end));
    stages.forEach((stage, i) => {
      stage.hidden = i >= state.shown.length;
      if (stage.hidden) return;
      const dot = Object.assign(document.createElement("span"), { className: "dot" });
      dot.style.setProperty("--c", state.shown[i].strategy.color);
      stage.querySelector("h3").replaceChildren(dot, state.shown[i].strategy.label);
    });
    $("step").max = state.last;
    show(0);
  }

  function show(step) {
    state.step = Math.min(Math.max(Math.round(step), 0), state.last);
    $("step").value = state.step;
    $("step").setAttribute("aria-valuetext", `step ${state.step} of ${state.last}`);
    $("clock").textContent = `${state.step} / ${state.last}`;
    state.shown.forEach(({ replay, trial, strategy }, i) => {
      const at = Math.min(state.step, replay.end), k = decisionAt(replay, at);
      const canvas = stages[i].querySelector("canvas");
      drawMap(canvas, replay, at, $("truth").checked);
      const known = Math.round(100 * replay.column.explored[at] / replay.cells ** 2);
      canvas.setAttribute("aria-label", `Map of ${strategy.label} in world ${trial.world} at step ${at}: ${known} % known`);
      const now = document.createElement("b");
      now.textContent = at === replay.end ? `${trial.status} after ${replay.end} steps` : `step ${at}, decision ${k + 1}, ${known} % known`;
      const score = `T = ${trial.T} steps, e = ${trial.e} m, η = ${trial.eta} m²/step`;
      stages[i].querySelector(".facts").replaceChildren(now, document.createElement("br"), `Whole trial: ${score}${trial.status === "explored" ? "" : ` (scored as ${trial.status})`}`);
    });
    for (const canvas of curves) {
      drawCurve(canvas, state.shown, state.step, state.last);
      canvas.setAttribute("aria-label", `${canvas.parentElement.querySelector("figcaption").textContent} until step ${state.step}`);
    }
  }

  function jump(direction) {
    const steps = unique(state.shown.flatMap(({ replay }) => [...replay.column.decided_at])).sort((a, b) => a - b);
    const others = direction > 0 ? steps.filter((step) => step > state.step) : steps.filter((step) => step < state.step).reverse();
    go(others.length ? others[0] : direction > 0 ? state.last : 0);
  }

  function go(step) { pause(); show(step); }

  function pause() {
    state.playing = false;
    $("play").classList.remove("running");
    $("play").setAttribute("aria-label", "Play");
  }

  function toggle() {
    if (state.playing || !state.shown.length) { pause(); return; }
    if (state.step >= state.last) show(0);
    state.playing = true;
    $("play").classList.add("running");
    $("play").setAttribute("aria-label", "Pause");
    let before = performance.now(), owed = 0;
    const run = ++state.clock;
    requestAnimationFrame(function frame(now) {
      if (!state.playing || run !== state.clock) return;
      owed += Math.min(now - before, 250) / 1000 * Number($("speed").value);
      before = now;
      if (owed >= 1) {
        show(state.step + Math.floor(owed));
        owed %= 1;
      }
      if (state.step >= state.last) pause();
      else requestAnimationFrame(frame);
    });
  }

  for (const select of Object.values(pick)) select.addEventListener("change", load);
  $("play").addEventListener("click", toggle);
  $("first").addEventListener("click", () => go(0));
  $("less").addEventListener("click", () => go(state.step - 1));
  $("more").addEventListener("click", () => go(state.step + 1));
  $("back").addEventListener("click", () => jump(-1));
  $("next").addEventListener("click", () => jump(1));
  $("step").addEventListener("input", () => go(Number($("step").value)));
  $("truth").addEventListener("change", () => show(state.step));
  $("replay").addEventListener("keydown", (event) => {
    const on = event.target;
    if (on.tagName === "SELECT" || event.altKey || event.ctrlKey || event.metaKey) return;
    if (event.key === " " && on.tagName !== "BUTTON" && on.type !== "checkbox") toggle();
    else if (event.key === "ArrowRight" || (event.key === "ArrowUp" && on.type === "range")) go(state.step + 1);
    else if (event.key === "ArrowLeft" || (event.key === "ArrowDown" && on.type === "range")) go(state.step - 1);
    else return;
    event.preventDefault();
  });
  let waiting = 0;
  new ResizeObserver(() => { cancelAnimationFrame(waiting); waiting = requestAnimationFrame(() => show(state.step)); }).observe($("replay"));

  fill(pick.map, maps.map((label, i) => [i, label]), start ? start.map : "");
  const still = window.matchMedia?.("(prefers-reduced-motion: reduce)").matches ?? true;
  load().then(() => { if (!still && state.shown.length && !state.playing) toggle(); });
})();
