// Draws every plot of the page from its description, with Observable Plot; hover gives numbers, a drag zooms its group.
"use strict";
(() => {
  const arrays = JSON.parse(document.getElementById("arrays").textContent).map(decode);
  const groups = new Map(); // zoomed interval of x, the axis that it is of, and series left out, by group of plots
  const DASHES = {triangle: "1.5 3"}; // each preset its own, as the symbols
  const LEFT = 70, NAMES = 150, SUPERSCRIPTS = "⁰¹²³⁴⁵⁶⁷⁸⁹";

  function decode(text) {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    return Array.from(new Float32Array(bytes.buffer), (v) => (Number.isNaN(v) ? null : v));
  }

  function number(value) {
    return value === 0 ? "0" : Math.abs(value) >= 1e-3 && Math.abs(value) < 1e5
      ? String(+value.toPrecision(5)) : value.toExponential(2).replace("e+", "e");
  }

  function withUnit(axis, value) {
    if (axis.categories.length) return axis.categories[Math.round(value)] ?? "";
    return `${axis.title} ${number(value)}${axis.unit && axis.unit !== "1" ? ` ${axis.unit}` : ""}`;
  }

  function power(value) {
    const exponent = Math.log10(value);
    if (Math.abs(exponent - Math.round(exponent)) > 1e-6) return "";
    return `10${[...String(Math.round(exponent))].map((c) => (c === "-" ? "⁻" : SUPERSCRIPTS[c])).join("")}`;
  }

  const isPower = (value) => Math.abs(Math.log10(value) - Math.round(Math.log10(value))) < 1e-6;

  function points(series, plot) {
    const shown = (v, axis) => v !== null && (!axis.logarithmic || v > 0);
    return series.x.map((k, i) => ({
      x: k, y: series.y[i], series, hint: series.hints[i] ?? "",
      low: series.low ? series.low[i] : null, high: series.high ? series.high[i] : null,
    })).map((p) => (shown(p.x, plot.x) && shown(p.y, plot.y) ? p : {...p, y: null}));
  }

  // The values with some room around them, so that no point lies on the frame.
  function domainOf(axis, values, room) {
    if (!values.length) return axis.logarithmic ? [1, 10] : [0, 1];
    const to = axis.logarithmic ? Math.log10 : (v) => v, back = axis.logarithmic ? (v) => 10 ** v : (v) => v;
    const low = to(Math.min(...values)), high = to(Math.max(...values));
    const least = axis.logarithmic ? 0.3 : Math.max(Math.abs(low), Math.abs(high), 1e-300) * 1e-9;
    const margin = Math.max((high - low) * room, (least - (high - low)) / 2, 0);
    return [back(low - margin), back(high + margin)];
  }

  function scale(axis, domain, vertical = false) {
    const label = (axis.unit && axis.unit !== "1" ? `${axis.title} [${axis.unit}]` : axis.title).trim();
    const options = {label: label || null, labelArrow: "none", labelAnchor: "center", domain};
    if (axis.categories.length) {
      return {...options, domain: [-0.6, axis.categories.length - 0.4], reverse: vertical,
        ticks: axis.categories.map((_, i) => i), tickFormat: (i) => axis.categories[i]};
    }
    return axis.logarithmic ? {...options, type: "log", ...ticks(domain)} : {...options, ticks: 5, tickFormat: undefined};
  }

  // A logarithmic axis labels powers of ten; one with fewer than two of them plain numbers, given one by one: of three
  // ticks within less than a decade the library may leave out every label.
  function ticks([low, high]) {
    const inside = (digits) => d3.scaleLog([low, high], [0, 1]).ticks(10).filter((v) => digits.some((d) => isPower(v / d)));
    if (inside([1]).length < 2) {
      const coarse = inside([1, 2, 5]);
      return {ticks: coarse.length < 2 ? d3.ticks(low, high, 3) : coarse, tickFormat: number};
    }
    const near = low >= 1e-3 && high <= 1e4;
    return {ticks: 6, tickFormat: near ? (v) => (isPower(v) ? number(v) : "") : power};
  }

  function hint(p, plot) {
    const lines = [p.series.name, withUnit(plot.x, p.x), withUnit(plot.y, p.y)];
    return [...lines, ...(p.hint ? [p.hint] : [])].filter(Boolean).join("\n");
  }

  function bars(plot, series) {
    const all = series.filter((s) => s.mark === "bar"), width = 0.8 / Math.max(1, all.length);
    const [across, along] = plot.y.categories.length ? ["y", "x"] : ["x", "y"];
    return all.map((s, k) => Plot[along === "y" ? "rectY" : "rectX"](s.points.filter((p) => p.y !== null), {
      [`${across}1`]: (p) => p[across] - 0.4 + k * width, [`${across}2`]: (p) => p[across] - 0.4 + (k + 1) * width, [along]: along,
      fill: s.style.colour, fillOpacity: s.style.dashed ? 0.45 : 0.9, stroke: s.style.colour, inset: 0.5,
    }));
  }

  const LETTER = 6.2; // [px] of a label, about

  // A label left of its point, above the line; where the frame would cut it, right of it and below.
  function besides(label, axis, [low, high], room) {
    if (label.beside) return {dx: 6, textAnchor: "start"};
    const to = axis.logarithmic ? Math.log10 : (v) => v, from = (to(label.x) - to(low)) / (to(high) - to(low)) * room;
    return from < LETTER * label.text.length + 3 ? {dx: 6, dy: 11, textAnchor: "start", clip: true} : {dx: -3, dy: -7, textAnchor: "end", clip: true};
  }

  function marksOf(plot, series, domain, room) {
    const marks = [Plot.frame({stroke: "var(--line)"})];
    for (const b of plot.bands) marks.push(Plot.rectX([b], {x1: "start", x2: "end", fill: b.colour, fillOpacity: 0.15, clip: true}));
    marks.push(Plot.gridX({ticks: 6, strokeOpacity: 0.12}), Plot.gridY({ticks: 6, strokeOpacity: 0.12}), ...bars(plot, series));
    for (const [k, r] of plot.rules.entries()) {
      const rule = r.across === "x" ? Plot.ruleX : Plot.ruleY;
      marks.push(rule([r.at], {stroke: r.colour || "var(--soft)", strokeDasharray: "2 3", clip: true}));
      if (r.text) marks.push(Plot.text([r.at], {[r.across]: (d) => d, text: () => r.text, fill: "var(--soft)", dx: 4, dy: r.across === "y" ? -6 : 3 + 13 * k,
        frameAnchor: r.across === "x" ? "top" : "left", textAnchor: "start", lineAnchor: r.across === "x" ? "top" : "bottom", clip: true}));
    }
    for (const s of series) {
      const style = {x: "x", y: "y", stroke: s.style.colour, clip: true};
      if (s.low && s.mark === "bar") marks.push(Plot.ruleY(s.points, {y: "y", x1: "low", x2: "high", stroke: "currentColor"}));
      else if (s.low) marks.push(Plot.ruleY(s.points.filter((p) => p.y !== null), {y: "y", x1: "low", x2: "high", stroke: s.style.colour, clip: true}));
      if (s.mark === "line" || s.mark === "both") marks.push(Plot.line(s.points, {...style, strokeWidth: s.style.width,
        strokeOpacity: s.style.colour === "currentColor" ? 0.35 : 1, strokeDasharray: s.style.dashed ? DASHES[s.style.symbol] ?? "6 3" : null}));
      if (s.mark === "points" || s.mark === "both") marks.push(Plot.dot(s.points, {...style, r: 4, symbol: s.style.symbol,
        fill: s.style.dashed ? "var(--page)" : s.style.colour}));
    }
    for (const l of plot.labels) marks.push(Plot.text([l], {x: "x", y: "y", text: "text", fill: l.colour, ...besides(l, plot.x, domain, room)}));
    const flat = series.flatMap((s) => s.points.filter((p) => p.y !== null));
    marks.push(Plot.tip(flat, Plot.pointer({x: "x", y: "y", title: (p) => hint(p, plot), maxRadius: 60})));
    return marks;
  }

  function draw(figure, plot, box) {
    const state = groups.get(figure.dataset.group), interval = state.across === plot.x.title ? state.interval : null;
    const series = plot.series.filter((s) => !state.hidden.has(s.name));
    const lines = series.every((s) => s.mark === "line");
    const inside = (p) => p.y !== null && (!interval || (p.x >= interval[0] && p.x <= interval[1]));
    const of = (key) => series.flatMap((s) => s.points.filter(inside).map((p) => p[key]));
    const across = series.flatMap((s) => s.points.filter((p) => p.x !== null && (lines || p.y !== null) && (!plot.x.logarithmic || p.x > 0)).map((p) => p.x));
    const rules = plot.rules.filter((r) => r.across === "y").map((r) => r.at);
    const spread = series.flatMap((s) => [...(s.low ?? []), ...(s.high ?? [])]);
    const left = plot.y.categories.length ? NAMES : LEFT;
    const width = Math.max(220, box.clientWidth), barred = series.some((s) => s.mark === "bar"), wide = width - left - 14;
    const zero = Math.min(0, ...across, ...spread), beside = plot.labels.filter((l) => l.beside);
    const room = Math.max(0, ...beside.map((l) => zero + (l.x - zero) * wide / Math.max(wide - LETTER * l.text.length - 6, wide / 4))); // for the texts
    const domain = interval ?? domainOf(plot.x, [...across, ...(plot.y.categories.length ? [0, ...spread, room] : [])], lines ? 0 : 0.06);
    const drawn = Plot.plot({
      width, height: plot.equal ? undefined : plot.height, aspectRatio: plot.equal ? 1 : undefined,
      marginLeft: left, marginBottom: 44, marginTop: 14, marginRight: 14, style: {background: "none", overflow: "visible"},
      x: scale(plot.x, domain),
      y: scale(plot.y, domainOf(plot.y, [...of("y"), ...rules, ...(barred ? [0] : [])], barred ? 0.02 : plot.labels.some((l) => !l.beside) ? 0.12 : 0.06), true), marks: marksOf(plot, series, domain, wide),
    });
    drawn.setAttribute("aria-hidden", "true"); // its box has a name, and says what it shows
    box.replaceChildren(drawn);
    const toX = drawn.scale("x");
    if (!plot.x.categories.length) brush(figure, drawn, (px) => toX.invert(px), width, plot.x.title);
  }

  function brush(figure, drawn, invert, width, across) {
    let start = null, shade = null;
    const at = (event) => Math.min(width - 14, Math.max(LEFT, event.clientX - drawn.getBoundingClientRect().left));
    drawn.addEventListener("pointerdown", (event) => {
      if (event.pointerType === "touch") return; // a finger scrolls
      start = at(event);
      drawn.setPointerCapture(event.pointerId); // the tip that is drawn anew below the pointer ends no drag
      shade = drawn.appendChild(document.createElementNS("http://www.w3.org/2000/svg", "rect"));
      for (const [k, v] of [["y", 14], ["height", drawn.viewBox.baseVal.height - 58], ["class", "brush"]]) shade.setAttribute(k, v);
    }, {capture: true}); // a plot that shows a tip keeps the event to itself
    drawn.addEventListener("pointermove", (event) => {
      if (start === null) return;
      shade.setAttribute("x", Math.min(start, at(event)));
      shade.setAttribute("width", Math.abs(at(event) - start));
    });
    const end = (event) => {
      if (start === null) return;
      const [a, b] = [start, at(event)].sort((p, q) => p - q);
      start = null;
      shade.remove();
      if (b - a > 6) zoom(figure, [invert(a), invert(b)], across);
    };
    drawn.addEventListener("pointerup", end);
    drawn.addEventListener("pointercancel", end);
    drawn.addEventListener("dblclick", () => zoom(figure, null));
  }

  // Plots over another axis stay as they are.
  function zoom(figure, interval, across = null) {
    Object.assign(groups.get(figure.dataset.group), {interval, across});
    redraw(figure.dataset.group);
  }

  function redraw(group) {
    const {interval, hidden} = groups.get(group);
    for (const figure of document.querySelectorAll(`figure.plot[data-group="${CSS.escape(group)}"]`)) {
      figure.querySelector(".whole").hidden = interval === null;
      for (const key of figure.querySelectorAll(".legend button")) key.setAttribute("aria-pressed", String(!hidden.has(key.dataset.name)));
      if (figure.drawn) figure.drawn();
    }
  }

  function ready(figure) {
    const panels = JSON.parse(figure.querySelector("script").textContent);
    for (const plot of panels) {
      for (const s of plot.series) {
        for (const key of ["x", "y", "low", "high"]) s[key] = s[key] === null ? null : arrays[s[key]];
        s.points = points(s, plot);
      }
    }
    figure.panels = panels;
    figure.drawn = () => [...figure.querySelectorAll(".panel")].forEach((box, k) => box.closest("[hidden]") || draw(figure, panels[k], box));
    figure.drawn();
  }

  // Panels of one choice at a time; without scripts all of them are there.
  function choose(figure) {
    const choices = figure.querySelector(".choose"), select = choices?.querySelector("select");
    if (!select) return;
    const show = () => {
      for (const panel of figure.querySelectorAll("[data-choice]")) panel.hidden = panel.dataset.choice !== select.value;
      if (figure.drawn) figure.drawn();
    };
    select.addEventListener("change", show);
    choices.hidden = false;
    show();
  }

  function listen(figure) {
    const {group} = figure.dataset;
    if (!groups.has(group)) groups.set(group, {interval: null, across: null, hidden: new Set()});
    figure.querySelector(".whole").addEventListener("click", () => zoom(figure, null));
    choose(figure);
    for (const key of figure.querySelectorAll(".legend button")) {
      key.addEventListener("click", () => {
        const {hidden} = groups.get(group);
        if (!hidden.delete(key.dataset.name)) hidden.add(key.dataset.name);
        redraw(group);
      });
    }
  }

  const figures = [...document.querySelectorAll("figure.plot")];
  const drawAll = () => figures.filter((f) => !f.drawn && f.offsetParent !== null).forEach(ready);
  const seen = new IntersectionObserver((entries) => {
    for (const {target, isIntersecting} of entries) if (isIntersecting && !target.drawn) ready(target);
  }, {rootMargin: "300px"});
  for (const figure of figures) {
    listen(figure);
    seen.observe(figure);
  }
  let width = innerWidth, pending = 0;
  addEventListener("resize", () => {
    if (innerWidth === width) return;
    width = innerWidth;
    cancelAnimationFrame(pending);
    pending = requestAnimationFrame(() => figures.forEach((f) => f.drawn && f.drawn()));
  });
  addEventListener("beforeprint", () => {
    drawAll();
    figures.forEach((f) => f.drawn && f.drawn());
  });
  document.addEventListener("toggle", (event) => {
    for (const f of event.target.querySelectorAll?.("figure.plot") ?? []) if (f.drawn) f.drawn();
  }, true);
})();
