(() => {
  "use strict";
  const TAU = 2 * Math.PI;
  const SLOWED = 6, NEAR = 0.02; // slow motion: how much, and within which part of the end about an event
  const PALETTE = ["ink", "soft", "line", "surface", "body", "edge", "mass", "rope", "ground", "stop", "force"];
  const PRINTED = { ink: "#1d2733", soft: "#5d6b7a", line: "#dde3ea", surface: "#ffffff", body: "#c9a46a", edge: "#7b5c2e", mass: "#4b5967", rope: "#7b6a4c", ground: "#8593a1", stop: "#a3542c", force: "#b3261e" };

  const unpack = (text, Kind) => {
    const raw = atob(text), bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
    return new Kind(bytes.buffer);
  };
  /* Numbers of half precision, which not every browser unpacks itself, times their unit. */
  const halves = (packed) => packed && Float32Array.from(unpack(packed[1], Uint16Array), (bits) => {
    const power = (bits >> 10) & 31, part = bits & 1023;
    return (bits & 0x8000 ? -1 : 1) * packed[0] * (power === 31 ? NaN : power ? (1 + part / 1024) * 2 ** (power - 15) : part * 2 ** -24);
  });
  const digits = (value) => Number.isFinite(value) ? value === 0 ? "0" : value.toExponential(2) : "–";
  const withUnit = (value, unit) => {
    const [prefix, power] = value >= 1e6 ? ["M", 1e6] : value >= 1e3 ? ["k", 1e3] : value >= 1 ? ["", 1] : value >= 1e-3 ? ["m", 1e-3] : ["µ", 1e-6];
    return `${+(value / power).toPrecision(3)} ${prefix}${unit}`;
  };
  const rounded = (value) => { // down to 1, 2 or 5 times a power of ten
    const power = 10 ** Math.floor(Math.log10(value));
    return power * (value >= 5 * power ? 5 : value >= 2 * power ? 2 : 1);
  };

  /* The motion of a scene: where its points are, and by how much each run's points are elsewhere. */
  class Motion {
    constructor(data) {
      Object.assign(this, { data, t: unpack(data.t, Float64Array), q: unpack(data.q, Float32Array), u: unpack(data.u, Float32Array), n: data.points.length });
      this.end = this.t[this.t.length - 1];
      this.runs = data.runs.map((run) => ({ ...run, d: unpack(run.d, Float32Array), torques: halves(run.torques), forces: halves(run.forces), own: Object.entries(run.aside).map(([name, text]) => [data.markers[name], unpack(text, Float32Array)]) }));
      this.torques = unpack(data.torques, Float32Array);
      this.forces = unpack(data.forces, Float32Array);
      this.marked = data.compared;
      this.carrier = new Map(data.carried);
      this.traces = new Map();
    }
    /* Frame before a time, and the part of the way to the next one. */
    locate(time) {
      const { t } = this;
      let low = 0, high = t.length - 1;
      while (high - low > 1) { const middle = (low + high) >> 1; if (t[middle] <= time) low = middle; else high = middle; }
      return [low, high > low ? Math.min(Math.max((time - t[low]) / (t[high] - t[low]), 0), 1) : 0];
    }
    between(values, width, column, [i, part]) {
      const a = values[i * width + column];
      return part === 0 ? a : part === 1 ? values[(i + 1) * width + column] : a + part * (values[(i + 1) * width + column] - a);
    }
    /* A coordinate of the reference: the cubic through values and speeds of both frames. */
    coordinate(k, [i, part]) {
      const { q, u, t } = this, { width } = this.data, a = i * width + k, b = a + width;
      if (part === 0) return q[a];
      if (part === 1) return q[b];
      const h = t[i + 1] - t[i], rest = 1 - part;
      return rest * rest * ((1 + 2 * part) * q[a] + part * h * u[a]) + part * part * ((3 - 2 * part) * q[b] - rest * h * u[b]);
    }
    /* Sum of coefficients times phasors, for all points or those that are asked for. */
    sum(re, im, offsets, out, only) {
      const { points } = this.data, count = only ? only.length : points.length;
      for (let m = 0; m < count; m++) {
        const p = only ? only[m] : m, row = points[p];
        let x = offsets ? row[0] : 0, y = offsets ? row[1] : 0;
        for (let j = 2; j < row.length; j += 3) {
          const k = row[j], a = row[j + 1], b = row[j + 2];
          x += a * re[k] - b * im[k];
          y += a * im[k] + b * re[k];
        }
        out[2 * p] = x;
        out[2 * p + 1] = y;
      }
      return out;
    }
    positions(at, only) {
      const { width, angles } = this.data, re = [], im = [];
      for (let k = 0; k < width; k++) {
        const q = this.coordinate(k, at);
        if (k < angles) { re[k] = Math.cos(q); im[k] = -Math.sin(q); } else {
          const c = this.carrier.get(k);
          re[k] = c === undefined ? q : q * re[c];
          im[k] = c === undefined ? 0 : q * im[c];
        }
      }
      return this.sum(re, im, true, new Float64Array(2 * this.n), only);
    }
    /* exp(-i d) - 1 is formed without subtracting nearly equal numbers, so that 1e-12 keeps its digits. */
    deviations(run, at, only) {
      const { width, angles } = this.data, re = [], im = [], turned = [];
      for (let k = 0; k < width; k++) {
        const q = this.coordinate(k, at), d = this.between(run.d, width, k, at);
        if (k < angles) {
          const half = Math.sin(d / 2), u = -2 * half * half, v = -Math.sin(d), c = Math.cos(q), s = -Math.sin(q);
          turned[k] = [u, v, c, s];
          re[k] = c * u - s * v;
          im[k] = c * v + s * u;
        } else if (this.carrier.has(k)) {
          const [u, v, c, s] = turned[this.carrier.get(k)], a = (q + d) * u + d, b = (q + d) * v;
          re[k] = c * a - s * b;
          im[k] = c * b + s * a;
        } else { re[k] = d; im[k] = 0; }
      }
      const out = this.sum(re, im, false, new Float64Array(2 * this.n), only);
      for (const [index, own] of run.own) {
        out[2 * index] += this.between(own, 2, 0, at);
        out[2 * index + 1] += this.between(own, 2, 1, at);
      }
      return out;
    }
    /* Frames and parts between them, so many that traces are smooth: a marker's way leaves no chord by a 2000th of the size. */
    get fine() {
      const value = [], { marked, t } = this, middle = (i, part) => this.positions([i, part], marked);
      for (let i = 0; i + 1 < t.length; i++) {
        const a = middle(i, 0), b = middle(i, 1), c = middle(i, 0.5);
        let off = 0;
        for (const p of marked) off = Math.max(off, Math.hypot(c[2 * p] - (a[2 * p] + b[2 * p]) / 2, c[2 * p + 1] - (a[2 * p + 1] + b[2 * p + 1]) / 2));
        const parts = Math.min(Math.max(Math.ceil(Math.sqrt(2000 * off / this.data.size)), 1), 8);
        for (let k = 0; k < parts; k++) value.push([i, k / parts]);
      }
      value.push([t.length - 1, 0]);
      Object.defineProperty(this, "fine", { value });
      return value;
    }
    /* Positions (of the reference: run undefined) or deviations of the markers at those instants. */
    trace(run) {
      if (!this.traces.has(run)) {
        const paths = this.marked.map(() => new Float64Array(2 * this.fine.length));
        this.fine.forEach((at, i) => {
          const xy = run ? this.deviations(run, at, this.marked) : this.positions(at, this.marked);
          this.marked.forEach((p, m) => { paths[m][2 * i] = xy[2 * p]; paths[m][2 * i + 1] = xy[2 * p + 1]; });
        });
        this.traces.set(run, paths);
      }
      return this.traces.get(run);
    }
    error(deviations) {
      let most = 0;
      for (const p of this.marked) most = Math.max(most, Math.hypot(deviations[2 * p], deviations[2 * p + 1]));
      return most;
    }
    /* Forces on joints' children and of stops, of the reference (run undefined) or of a run; NaN where it does not tell them. */
    loads(run, at) {
      const { data } = this, { forces, torques } = run || this, read = (values, width, k) => values && values.length ? this.between(values, width, k, at) : NaN;
      const joints = data.joints.map(([name, point], j) => ({ name, point, force: [0, 1].map((axis) => read(forces, 2 * data.joints.length, 2 * j + axis)) }));
      const stops = data.stops.map(([name, point, along, unit, sense], s) => ({ name, point, along, unit, sense, value: read(torques, data.stops.length, s) }));
      return { joints, stops };
    }
    /* Largest force and torque but for poles: of all frames the 98th percentile of their largest. */
    get scales() {
      const robust = (values, width, of) => {
        const largest = [];
        for (let i = 0; width && i < values.length; i += width) largest.push(of(values.subarray(i, i + width)));
        return largest.sort((a, b) => a - b)[Math.floor(0.98 * (largest.length - 1))] || 0;
      };
      const { stops, joints } = this.data, columns = stops.map((stop) => stop[3] === "N");
      const pick = (wanted) => (row) => Math.max(0, ...Array.from(row).filter((_, k) => columns[k] === wanted).map(Math.abs));
      const force = robust(this.forces, 2 * joints.length, (row) => { let most = 0; for (let k = 0; k < row.length; k += 2) most = Math.max(most, Math.hypot(row[k], row[k + 1])); return most; });
      const value = { force: Math.max(force, robust(this.torques, stops.length, pick(true))), torque: robust(this.torques, stops.length, pick(false)) };
      Object.defineProperty(this, "scales", { value });
      return value;
    }
  }

  /* Draws shapes over points onto a canvas; metres become pixels by one scale, y up. */
  class Pencil {
    constructor(canvas) { this.canvas = canvas; this.context = canvas.getContext("2d"); }
    fit([x0, y0, x1, y1]) {
      const { canvas } = this, width = canvas.clientWidth || 600, ratio = window.devicePixelRatio || 1;
      const least = width < 500 ? 0.7 : 0.36, most = Math.max(260, Math.min(width * 1.1, parseFloat(getComputedStyle(canvas).maxHeight) || Infinity));
      canvas.style.height = `${Math.round(Math.min(Math.max(width * (y1 - y0) / (x1 - x0), least * width, 240), most))}px`;
      const height = canvas.clientHeight; // less the border
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
      this.context.setTransform(canvas.width / width, 0, 0, canvas.height / height, 0, 0);
      this.scale = Math.min(width / (x1 - x0), height / (y1 - y0));
      Object.assign(this, { width, height, left: width / 2 - this.scale * (x0 + x1) / 2, top: height / 2 + this.scale * (y0 + y1) / 2 });
    }
    x(x) { return this.left + x * this.scale; }
    y(y) { return this.top - y * this.scale; }
    path(xy, indices, closed) {
      const c = this.context;
      c.beginPath();
      indices.forEach((p, i) => c[i ? "lineTo" : "moveTo"](this.x(xy[2 * p]), this.y(xy[2 * p + 1])));
      if (closed) c.closePath();
    }
    stroke(colour, width, dash = []) {
      Object.assign(this.context, { strokeStyle: colour, lineWidth: width, lineCap: dash.length ? "butt" : "round", lineJoin: "round" });
      this.context.setLineDash(dash);
      this.context.stroke();
      this.context.setLineDash([]);
    }
    fill(colour) { this.context.fillStyle = colour; this.context.fill(); }
    circle(x, y, radius, from = 0, to = TAU) { this.context.beginPath(); this.context.arc(x, y, radius, from, to); }
    arrow(x, y, u, v, head, colour, width) {
      const c = this.context, length = Math.hypot(u - x, v - y);
      if (!(length > 1)) return;
      const size = Math.min(head, 0.6 * length), a = (u - x) / length, b = (v - y) / length;
      c.beginPath(); c.moveTo(x, y); c.lineTo(u - a * size * 0.8, v - b * size * 0.8);
      this.stroke(colour, width);
      c.beginPath(); c.moveTo(u, v); c.lineTo(u - a * size - b * size * 0.4, v - b * size + a * size * 0.4); c.lineTo(u - a * size + b * size * 0.4, v - b * size - a * size * 0.4); c.closePath();
      this.fill(colour);
    }
    /* An arc with a head; the sweep is clockwise as seen, as on the canvas. */
    turn(x, y, radius, sweep, colour, width) {
      const from = -Math.PI / 2, to = from + sweep, sign = Math.sign(sweep), head = Math.min(9, radius * 0.6, Math.abs(sweep) * radius);
      if (Math.abs(sweep) * radius < 2) return;
      const back = to - sign * head / radius, c = this.context;
      c.beginPath(); c.arc(x, y, radius, from, back, sweep < 0);
      this.stroke(colour, width);
      const tip = [x + radius * Math.cos(to), y + radius * Math.sin(to)];
      c.beginPath(); c.moveTo(...tip);
      for (const r of [radius - head * 0.45, radius + head * 0.45]) c.lineTo(x + r * Math.cos(back), y + r * Math.sin(back));
      c.closePath();
      this.fill(colour);
    }
    /* The polyline of any shape that is not filled. */
    trace([kind, , points, size, way], xy) {
      const X = (p) => xy[2 * p], Y = (p) => xy[2 * p + 1], c = this.context, [a, b, d] = points;
      if (kind === "line" || kind === "area") return this.path(xy, points, kind === "area");
      if (kind === "disc") return this.circle(this.x(X(a)), this.y(Y(a)), Math.max(size * this.scale, 1.5));
      c.beginPath();
      const to = (x, y, i) => c[i ? "lineTo" : "moveTo"](this.x(x), this.y(y));
      if (kind === "between") {
        const u = X(b) - X(a), v = Y(b) - Y(a), length = Math.hypot(u, v) || Infinity;
        way.forEach(([s, aside], i) => to(X(a) + s * u - aside * v / length, Y(a) + s * v + aside * u / length, i));
      } else if (kind === "spiral") {
        const from = Math.atan2(Y(b) - Y(a), X(b) - X(a)), sweep = Math.atan2(Y(d) - Y(a), X(d) - X(a)) - from + 2 * TAU;
        for (let i = 0; i <= 60; i++) {
          const r = size * (0.25 + 0.75 * i / 60), angle = from + sweep * i / 60;
          to(X(a) + r * Math.cos(angle), Y(a) + r * Math.sin(angle), i);
        }
      } else if (kind === "wheel") {
        const u = X(d) - X(b), v = Y(d) - Y(b), rolled = ((X(a) - X(b)) * u + (Y(a) - Y(b)) * v) / Math.hypot(u, v) / size;
        for (let i = 0; i < 3; i++) {
          const angle = -rolled + i * Math.PI / 3, r = size * 0.92;
          to(X(a) - r * Math.cos(angle), Y(a) - r * Math.sin(angle), 0);
          to(X(a) + r * Math.cos(angle), Y(a) + r * Math.sin(angle), 1);
        }
      } else if (kind === "hatch") {
        const u = X(b) - X(a), v = Y(b) - Y(a), length = Math.hypot(u, v), count = Math.min(Math.max(Math.round(length / size), 1), 400);
        to(X(a), Y(a), 0); to(X(b), Y(b), 1);
        for (let i = 0; i < count; i++) {
          const s = (i + 1) / count, x = X(a) + s * u, y = Y(a) + s * v, f = 0.75 * size / (length || 1);
          to(x, y, 0); to(x - f * (u - v), y - f * (v + u), 1);
        }
      }
    }
    /* A shape of the reference, in the colours of the page. */
    shape(shape, xy, colours, shown) {
      const [kind, role, points, size] = shape, c = this.context, px = size * this.scale;
      c.globalAlpha = shown;
      if (kind === "arrow") this.arrow(...points.flatMap((p) => [this.x(xy[2 * p]), this.y(xy[2 * p + 1])]), Math.max(px, 7), colours.force, 2);
      else if (kind === "turn") this.turn(this.x(xy[2 * points[0]]), this.y(xy[2 * points[0] + 1]), Math.max(px, 10), shape[4][0][0], colours.force, 2);
      else if (role === "body" && kind !== "disc") {
        this.trace(shape, xy);
        this.stroke(colours.edge, Math.max(px, 2) + 2);
        this.stroke(colours.body, Math.max(px, 2));
        if (kind === "area") this.fill(colours.body);
      } else if (role === "centre" && kind === "disc") this.centre(shape, xy, colours);
      else {
        this.trace(shape, xy);
        if (kind === "wheel") { this.stroke(colours.edge, 1.2); this.circle(this.x(xy[2 * points[0]]), this.y(xy[2 * points[0] + 1]), px); this.stroke(colours.edge, 2.2); } else this.plain(kind, role, px, colours);
      }
      c.globalAlpha = 1;
    }
    plain(kind, role, px, colours) {
      const filled = { mass: "mass", body: "body", joint: "surface", ground: "line", stop: "stop", marker: "ink" }[role];
      if (filled && (kind === "disc" || kind === "area")) this.fill(colours[filled]);
      if (role === "marker") return;
      const line = { rope: "rope", mass: "surface", body: "edge", joint: "edge", ground: "ground", guide: "ground", stop: "stop", centre: "edge" }[role] || "soft";
      this.stroke(colours[line], kind === "disc" || kind === "area" ? 1.3 : kind === "hatch" ? 1.2 : Math.max(px, 1.5));
    }
    /* The sign of a centre of mass. */
    centre([, , [p], size], xy, colours) {
      const x = this.x(xy[2 * p]), y = this.y(xy[2 * p + 1]), radius = Math.max(size * this.scale, 3);
      this.circle(x, y, radius); this.fill(colours.surface);
      for (const quarter of [0, Math.PI]) {
        this.context.beginPath(); this.context.moveTo(x, y); this.context.arc(x, y, radius, quarter, quarter + Math.PI / 2);
        this.fill(colours.ink);
      }
      this.circle(x, y, radius); this.stroke(colours.ink, 1);
    }
    text(text, x, y, colour, background) {
      const c = this.context;
      c.font = "12px system-ui, sans-serif";
      Object.assign(c, { lineJoin: "round", lineWidth: 3, strokeStyle: background, fillStyle: colour });
      const width = c.measureText(text).width, left = Math.min(Math.max(x, 3), this.width - width - 3), line = Math.min(Math.max(y, 12), this.height - 4);
      c.strokeText(text, left, line);
      c.fillText(text, left, line);
    }
  }

  class Player {
    constructor(root) {
      this.root = root;
      const find = (name) => root.querySelector(name);
      Object.assign(this, { canvas: find("canvas"), bar: find(".animation-bar input"), ticks: find(".animation-ticks"), clock: find(".animation-clock"), magnify: find(".animation-magnify input"), factor: find(".animation-magnify output"), speed: find(".animation-speed"), solver: find(".animation-solver"), rows: find("tbody"), button: find(".animation-play") });
      this.pencil = new Pencil(this.canvas);
      this.scenes = JSON.parse(find("script").textContent);
      this.motions = [];
      this.option = (name) => find(`.animation-${name}`).checked;
      this.paint();
      this.listen(find);
      this.choose(0);
    }
    listen(find) {
      this.bar.addEventListener("input", () => this.seek(+this.bar.value));
      this.magnify.addEventListener("input", () => this.draw());
      this.button.addEventListener("click", () => this.toggle());
      for (const name of ["traces", "forces", "names"]) find(`.animation-${name}`).addEventListener("change", () => this.draw());
      this.solver.addEventListener("change", () => { find(".animation-forces").checked = true; this.draw(); });
      for (const button of this.root.querySelectorAll("[data-scene]")) button.addEventListener("click", () => this.choose(+button.dataset.scene));
      this.root.addEventListener("keydown", (event) => this.key(event));
      new ResizeObserver(() => { if (this.canvas.clientWidth !== this.pencil.width) this.resize(); }).observe(this.canvas);
      matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { this.paint(); this.draw(); });
      addEventListener("beforeprint", () => { this.colours = PRINTED; this.draw(); });
      addEventListener("afterprint", () => { this.paint(); this.draw(); });
    }
    key(event) {
      const plain = event.target === this.canvas || event.target === this.bar;
      if (event.key === " " && !event.target.closest("button, select, summary, input[type=checkbox]")) this.toggle();
      else if (plain && (event.key === "ArrowRight" || event.key === "ArrowLeft")) this.seek(this.time + (event.key === "ArrowRight" ? 1 : -1) * this.motion.end * (event.shiftKey ? 0.05 : 0.005));
      else if (plain && (event.key === "Home" || event.key === "End")) this.seek(event.key === "End" ? this.motion.end : 0);
      else return;
      event.preventDefault();
    }
    paint() {
      const style = getComputedStyle(this.root);
      this.colours = Object.fromEntries(PALETTE.map((name) => [name, style.getPropertyValue(`--a-${name}`).trim() || PRINTED[name]]));
    }
    choose(index) {
      this.pause();
      const { root } = this;
      this.motion = this.motions[index] ||= new Motion(this.scenes[index]);
      const { data, end } = this.motion;
      for (const button of root.querySelectorAll("[data-scene]")) button.setAttribute("aria-pressed", String(+button.dataset.scene === index));
      this.canvas.setAttribute("aria-label", `${data.name}, drawn in motion: ${data.label} and ${this.motion.runs.length} runs over it`);
      root.querySelector(".animation-notes").textContent = data.notes;
      Object.assign(this.bar, { max: end, value: 0 });
      this.magnify.value = data.magnification;
      root.querySelector(".animation-runs").hidden = !this.motion.runs.length;
      this.magnify.closest("label").hidden = !this.motion.runs.some((run) => run.compared);
      this.shown = new Map([[undefined, true], ...this.motion.runs.map((run) => [run, true])]);
      this.list();
      this.solvers();
      this.speeds();
      this.table();
      this.touched = false;
      const last = data.events.filter((event) => event.time > 0).at(-1);
      this.time = last && last.time > 0.4 * end ? last.time : 0.75 * end; // a picture with some traces, until it is played
      this.resize();
    }
    list() {
      this.rows.replaceChildren(...[...this.shown.keys()].map((run) => {
        const row = document.createElement("tr");
        row.innerHTML = `<td><label><input type="checkbox" checked> <svg width="30" height="10" aria-hidden="true"><line x1="1" y1="5" x2="29" y2="5"/></svg> <span></span></label></td><td class="animation-number"></td>`;
        row.querySelector("span").textContent = run ? run.name : this.motion.data.label;
        const line = row.querySelector("line");
        line.style.stroke = run ? run.colour : "var(--a-body)";
        line.style.strokeWidth = run?.compared ? 2.5 : 7;
        if (run?.compared && run.dashed) line.style.strokeDasharray = "6 4";
        row.querySelector("input").addEventListener("change", (event) => { this.shown.set(run, event.target.checked); this.draw(); });
        return row;
      }));
    }
    /* Whose forces can be drawn: those of the reference, and of every run that tells some. */
    solvers() {
      const telling = this.motion.runs.filter((run) => run.forces || run.torques);
      this.solver.replaceChildren(new Option(this.motion.data.label, ""), ...telling.map((run) => new Option(run.name, run.name)), new Option("all that are shown", "*"));
      this.solver.closest("label").hidden = !telling.length;
    }
    get telling() {
      const { value } = this.solver;
      return value === "*" ? [...this.shown].filter(([, shown]) => shown).map(([run]) => run) : [this.runNamed(value || null)];
    }
    speeds() {
      const all = [];
      for (let power = -5; power <= 3; power++) for (const digit of [1, 2, 5]) all.push(digit * 10 ** power);
      const wanted = this.motion.end / 7, best = all.reduce((a, b) => Math.abs(Math.log(b / wanted)) < Math.abs(Math.log(a / wanted)) ? b : a);
      const near = all.filter((speed) => speed >= best / 60 && speed <= best * 12);
      this.speed.replaceChildren(...near.map((speed) => new Option(`${+speed.toPrecision(1)} ×`, speed, speed === best, speed === best)));
    }
    table() {
      const { data } = this.motion, details = this.root.querySelector(".animation-events"), cell = (tag, text, scope) => { const made = document.createElement(tag); made.textContent = text; if (scope) made.scope = scope; return made; };
      const row = (cells) => { const made = document.createElement("tr"); made.append(...cells); return made; };
      details.hidden = !data.events.length;
      const head = document.createElement("thead"), body = document.createElement("tbody");
      head.append(row([cell("th", "event", "col"), cell("th", `${data.label} [s]`, "col"), ...data.runs.map((run) => cell("th", run.compared ? `${run.name} later by [s]` : `${run.name} [s]`, "col"))]));
      const text = (event, run) => {
        const time = event.runs[run.name];
        if (time == null) return "–";
        if (!run.compared) return time.toPrecision(9);
        return event.reference == null ? `at ${time.toPrecision(6)}` : digits(time - event.reference);
      };
      body.append(...data.events.map((event) => row([cell("th", event.name, "row"), cell("td", event.reference == null ? "–" : event.reference.toPrecision(9)), ...data.runs.map((run) => cell("td", text(event, run)))])));
      details.querySelector("table").replaceChildren(head, body);
    }
    /* Names of events below the bar, in up to three rows; where there is no room, the tick alone. */
    label() {
      const { data, end } = this.motion, width = this.ticks.clientWidth, rows = [-Infinity, -Infinity, -Infinity];
      this.ticks.replaceChildren(...data.events.map((event) => {
        const button = document.createElement("button");
        button.type = "button";
        button.title = `${event.name}: ${event.time.toPrecision(6)} s`;
        button.setAttribute("aria-label", `go to ${event.name}, ${event.time.toPrecision(4)} s`);
        button.innerHTML = "<span></span>";
        button.firstChild.textContent = event.name;
        button.addEventListener("click", () => this.seek(event.time));
        return button;
      }));
      let depth = 0;
      const widths = [...this.ticks.children].map((button) => button.offsetWidth);
      [...this.ticks.children].forEach((button, i) => {
        const at = data.events[i].time / end * width, left = Math.max(0, Math.min(at + 4, width - widths[i])), row = rows.findIndex((edge) => left > edge + 8);
        if (row < 0) { button.textContent = ""; button.className = "animation-unnamed"; button.style.left = `${at}px`; return; }
        rows[row] = left + widths[i];
        depth = Math.max(depth, row + 1);
        button.style.left = `${left}px`;
        button.style.top = `${row * 1.25}rem`;
        button.style.setProperty("--drop", `${row * 1.25}rem`);
        button.style.setProperty("--stem", `${at - left - 1}px`);
      });
      this.ticks.style.height = `${depth * 1.25}rem`;
    }
    resize() { this.pencil.fit(this.motion.data.box); this.label(); this.draw(); }
    seek(time) { this.touched = true; this.time = Math.min(Math.max(time, 0), this.motion.end); this.draw(); }
    toggle() { if (this.playing) this.pause(); else this.play(); }
    pause() {
      this.playing = false;
      delete this.root.dataset.playing;
      this.button.setAttribute("aria-label", "play");
    }
    play() {
      if (!this.touched || this.time >= this.motion.end) this.time = 0;
      this.touched = this.playing = true;
      this.root.dataset.playing = "";
      this.button.setAttribute("aria-label", "pause");
      let before;
      const step = (now) => {
        if (!this.playing) return;
        this.time = Math.min(this.time + Math.min(now - (before ?? now), 100) / 1e3 * this.rate(), this.motion.end);
        before = now;
        this.draw();
        if (this.time >= this.motion.end) this.pause(); else requestAnimationFrame(step);
      };
      requestAnimationFrame(step);
    }
    rate() {
      const speed = +this.speed.value, { data, end } = this.motion;
      if (!this.option("slow")) return speed;
      const nearest = Math.min(Infinity, ...data.events.map((event) => Math.abs(event.time - this.time)));
      return speed / (1 + (SLOWED - 1) * Math.max(0, Math.min(1, 2 - nearest / (NEAR * end))));
    }
    /* To two digits, as it is shown. */
    get magnification() { return +(10 ** +this.magnify.value).toPrecision(2); }
    /* From another start a motion is drawn as it is. */
    factorOf(run) { return run.compared ? this.magnification : 1; }
    runPoints(run, at, reference) {
      const deviations = this.motion.deviations(run, at), magnification = this.factorOf(run);
      return [deviations, reference.map((value, i) => value + magnification * deviations[i])];
    }
    draw() {
      const started = performance.now(), { motion, pencil, colours, time } = this, { data } = motion;
      const at = motion.locate(time), reference = motion.positions(at);
      pencil.context.clearRect(0, 0, pencil.width, pencil.height);
      if (this.option("traces")) this.drawTraces(at);
      if (this.shown.get(undefined)) for (const shape of data.shapes) pencil.shape(shape, reference, colours, this.gone(shape[5]) ? 0.3 : 1);
      motion.runs.forEach((run, i) => this.drawRun(run, at, reference, this.rows.children[i + 1].lastElementChild, this.thinner(i, 1.6, 1.1)));
      if (this.option("forces")) this.drawForces(at, reference);
      if (this.option("names")) this.drawNames(reference);
      this.bar.value = time;
      this.bar.setAttribute("aria-valuetext", `${time.toPrecision(4)} seconds`);
      const places = Math.max(0, Math.min(6, 3 - Math.floor(Math.log10(motion.end))));
      const lost = data.horizon !== null && time > data.horizon;
      this.clock.textContent = `${time.toFixed(places)} s${lost ? ", not predictable" : ""}`;
      const factor = this.magnification;
      this.factor.textContent = `× ${factor.toLocaleString("en")}`;
      this.magnify.setAttribute("aria-valuetext", this.factor.textContent);
      Object.assign(this.canvas.dataset, { time, frame: at[0], magnification: factor, milliseconds: (performance.now() - started).toFixed(2) });
    }
    gone(stop) { return stop && this.motion.data.events.some((event) => event.kind === "release" && event.stop === stop && event.reference !== null && event.reference < this.time); }
    /* Lines of later runs are thinner, so that of lines that coincide each is seen. */
    thinner(i, least, step) { return Math.max(least + step * Math.min(this.motion.runs.length - 1 - i, 7) * Math.min(1, this.pencil.width / 800), 1); }
    drawRun(run, at, reference, cell, width) {
      const { pencil, motion } = this, [deviations, xy] = this.runPoints(run, at, reference), error = motion.error(deviations);
      const text = run.compared ? digits(error) : "another start";
      if (cell.textContent !== text) cell.textContent = text;
      if (!this.shown.get(run) || Number.isNaN(deviations[0])) return;
      if (!run.compared) {
        const colours = { ...this.colours, body: run.colour, mass: run.colour, rope: run.colour };
        for (const shape of motion.data.shapes) pencil.shape(shape, xy, colours, 1);
        return;
      }
      for (const shape of motion.data.shapes) {
        if (!shape[6]) continue;
        pencil.trace(shape, xy);
        if (shape[1] === "marker") { pencil.fill(run.colour); continue; }
        pencil.stroke(run.colour, shape[0] === "between" || shape[0] === "spiral" ? 0.6 * width : width, run.dashed ? [7, 5] : []);
      }
    }
    drawTraces(at) {
      const { motion, pencil } = this, c = pencil.context, reference = motion.trace(), later = motion.fine.findIndex(([i, part]) => i > at[0] || (i === at[0] && part > at[1])), last = later < 0 ? motion.fine.length - 1 : later - 1;
      for (const [run, shown] of this.shown) {
        if (!shown) continue;
        const width = run?.compared ? this.thinner(motion.runs.indexOf(run), 0.9, 0.45) : 1.6, magnification = run ? this.factorOf(run) : 1;
        const paths = motion.trace(run);
        const now = run ? this.runPoints(run, at, motion.positions(at))[1] : motion.positions(at);
        paths.forEach((path, m) => {
          const from = reference[m], p = motion.marked[m];
          c.beginPath();
          for (let i = 0; i <= last; i++) {
            const x = run ? from[2 * i] + magnification * path[2 * i] : path[2 * i], y = run ? from[2 * i + 1] + magnification * path[2 * i + 1] : path[2 * i + 1];
            c[i ? "lineTo" : "moveTo"](pencil.x(x), pencil.y(y));
          }
          c.lineTo(pencil.x(now[2 * p]), pencil.y(now[2 * p + 1]));
          c.globalAlpha = run ? 0.75 : 0.9;
          pencil.stroke(run ? run.colour : this.colours.soft, width, run?.compared && run.dashed ? [6, 5] : []);
          c.globalAlpha = 1;
        });
      }
    }
    drawForces(at, reference) {
      const { motion, colours } = this;
      for (const run of this.telling) {
        const xy = run ? this.runPoints(run, at, reference)[1] : reference;
        if (Number.isFinite(xy[0])) this.drawLoads(motion.loads(run, at), xy, run ? run.colour : colours.force);
      }
      this.drawScales();
    }
    drawLoads({ joints, stops }, xy, colour) {
      const { pencil, motion: { scales } } = this, k = this.longest / scales.force;
      const arrow = (p, [u, v]) => {
        const x = pencil.x(xy[2 * p]), y = pencil.y(xy[2 * p + 1]), length = Math.hypot(u, v) * k, cut = Math.min(1, 3 * this.longest / (length || 1));
        pencil.arrow(x, y, x + u * k * cut, y - v * k * cut, 9, colour, 2);
      };
      for (const { point, force } of joints) arrow(point, force);
      for (const { point: p, along, unit, sense, value } of stops) {
        if (!value) continue; // nor where it is not told
        if (unit === "N") { const u = xy[2 * along] - xy[2 * p], v = xy[2 * along + 1] - xy[2 * p + 1], length = Math.hypot(u, v); arrow(p, [value * u / length, value * v / length]); } else pencil.turn(pencil.x(xy[2 * p]), pencil.y(xy[2 * p + 1]), 20, Math.max(-5.8, Math.min(5.8, sense * value / scales.torque * 4.7)), colour, 2.5);
      }
    }
    get longest() { return 0.17 * Math.min(this.pencil.width, this.pencil.height); }
    drawScales() {
      const { pencil, colours, motion: { scales } } = this, colour = colours.force;
      let y = pencil.height - 12;
      if (scales.torque) { const value = rounded(scales.torque); pencil.turn(24, y - 6, 9, value / scales.torque * 4.7, colour, 2); pencil.text(withUnit(value, "N m"), 42, y, colours.ink, colours.surface); y -= 26; }
      if (scales.force) { const value = rounded(scales.force), length = value * this.longest / scales.force; pencil.arrow(10, y - 4, 10 + length, y - 4, 9, colour, 2); pencil.text(withUnit(value, "N"), 18 + length, y, colours.ink, colours.surface); }
    }
    drawNames(xy) {
      const { pencil, colours } = this, { markers } = this.motion.data;
      const taken = [];
      for (const [name, p] of Object.entries(markers)) {
        const x = pencil.x(xy[2 * p]) + 9;
        let y = pencil.y(xy[2 * p + 1]) - 8;
        while (taken.some(([u, v]) => Math.abs(u - x) < 90 && Math.abs(v - y) < 13)) y += 14;
        taken.push([x, y]);
        pencil.text(name, x, y, colours.soft, colours.surface);
      }
    }
    runNamed(name) { return name == null || name === "reference" ? undefined : this.motion.runs.find((run) => run.name === name); }
    /* Where a marker is, in metres: of the reference, or of a run with its deviation as it is or magnified. */
    position(marker, name, magnified) {
      const at = this.motion.locate(this.time), p = this.motion.data.markers[marker], run = this.runNamed(name), xy = this.motion.positions(at);
      const d = run ? this.motion.deviations(run, at) : null, k = run && magnified ? this.factorOf(run) : 1;
      return [0, 1].map((axis) => xy[2 * p + axis] + (d ? k * d[2 * p + axis] : 0));
    }
    hook() {
      const player = this;
      return {
        seek: (time) => player.seek(time), play: () => player.play(), pause: () => player.pause(), choose: (index) => player.choose(index),
        magnify: (factor) => { player.magnify.value = Math.log10(factor); player.draw(); },
        get time() { return player.time; }, get playing() { return Boolean(player.playing); }, get times() { return Array.from(player.motion.t); },
        get runs() { return player.motion.runs.map((run) => run.name); }, get magnification() { return player.magnification; },
        /* CSS pixels from the canvas's left upper corner, of a marker as it is drawn now. */
        pixelOf: (marker, run) => { const [x, y] = player.position(marker, run, true); return [player.pencil.x(x), player.pencil.y(y)]; },
        /* Metres, deviations as they are. */
        dataOf: (marker, run) => player.position(marker, run, false),
        /* Whose forces are drawn, and those of a solver: [N] by joint, [N m, or N on points] by stop. */
        forces: (name) => { player.solver.value = name; player.solver.dispatchEvent(new Event("change")); },
        forcesOf: (run) => { const { joints, stops } = player.motion.loads(player.runNamed(run), player.motion.locate(player.time)); return { joints: Object.fromEntries(joints.map((each) => [each.name, each.force])), stops: Object.fromEntries(stops.map((each) => [each.name, each.value])) }; },
        errorOf: (run) => player.motion.error(player.motion.deviations(player.runNamed(run), player.motion.locate(player.time))),
      };
    }
  }

  const start = () => {
    for (const root of document.querySelectorAll("section.animation")) {
      if (!root.trebucheck) root.trebucheck = new Player(root).hook();
    }
  };
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", start); else start();
})();
