// The grid of verdicts: filters, sorting, what a cell opens. Its state is in the address, behind '#'.
"use strict";
for (const section of document.querySelectorAll("section.verdicts")) {
  const data = JSON.parse(section.querySelector("script[type='application/json']").textContent);
  const find = (selector) => section.querySelector(selector);
  const table = find("table"), body = table.tBodies[0], card = find(".card"), counts = find(".counts");
  const heads = [...table.querySelectorAll(".names th[data-column]")];
  const groups = [...table.querySelectorAll(".groups th")];
  // Quantities of a card come as lists: the number of what several share, and their own.
  const SHARED = ["quantity", "subject", "tolerance", "unit", "count", "source"], OWN = ["error", "ratio", "part", "holds"];
  const named = ([shared, ...own]) => Object.fromEntries(
    [...SHARED.map((name, k) => [name, data.shared[shared][k]]), ...OWN.map((name, k) => [name, own[k]])]);
  for (const row of data.rows) for (const cell of row.cells) if (cell) cell.quantities = cell.quantities.map(named);
  const rows = [...body.querySelectorAll("tr[data-row]")].map((tr, i) => ({
    ...data.rows[i], place: i, tr, head: tr.cells[0], tds: [...tr.cells].slice(-data.columns.length),
  }));
  // Of each cell of the table's body: its row, and the number of its column; -1 is the row's head.
  const places = new Map(rows.flatMap((row) => [[row.head, {row, j: -1}], ...row.tds.map((td, j) => [td, {row, j}])]));
  const headings = new Map([...body.querySelectorAll("tr.group")].map((tr) => [tr.textContent.trim(), tr]));
  const text = (index) => data.texts[index], kept = (text) => data.texts.push(text) - 1;
  for (const {engine, preset, cells, tds} of rows) cells.forEach((cell, j) => cell && Object.assign(cell, {
    title: kept(`${engine} ${preset}: ${data.columns[j].name}`), lead: kept(tds[j].getAttribute("aria-label")),
  }));
  const element = (name, options = {}, ...children) => {
    const made = Object.assign(document.createElement(name), options);
    made.append(...children);
    return made;
  };

  // --- State

  const FILTERS = ["preset", "engine", "scheme", "feature"];
  const state = {rows: "", sort: "", show: "", only: "", cell: "", preset: [], engine: [], scheme: [], feature: []};

  function readAddress() {
    const asked = new URLSearchParams(location.hash.includes("=") ? location.hash.slice(1) : "");
    for (const name of ["rows", "sort", "show", "only", "cell"]) state[name] = asked.get(name) ?? "";
    for (const name of FILTERS) state[name] = asked.getAll(name);
  }
  function writeAddress() {
    const kept = new URLSearchParams();
    for (const [name, value] of Object.entries(state)) for (const each of [value].flat()) if (each) kept.append(name, each);
    const address = kept.size || location.hash.includes("=") ? `#${kept}` : location.hash;
    history.replaceState(null, "", address === "#" ? location.pathname + location.search : address);
  }

  // --- Rows and columns that are shown, in order

  const chosen = (name, value) => !state[name].length || state[name].includes(value);
  let shown = {rows: [], columns: [], presets: [], lines: []};

  // More rows than these fit no screen: an engine has one then, with a cell for each of its presets.
  const MOST = 40, small = matchMedia("(max-width: 900px)");
  const ofPresets = () => state.show !== "" || state.sort.startsWith("problem"); // numbers, and one error a row
  const asEngines = () => {
    if (ofPresets()) return false;
    return state.rows ? state.rows === "engines" : shown.rows.length > MOST && !small.matches;
  };

  const agreeing = (row) => shown.columns.filter((j) => row.cells[j]?.state === 0).length;

  function choose() {
    shown.rows = rows.filter((row) => chosen("preset", row.preset) && chosen("engine", row.engine) && chosen("scheme", row.group));
    shown.columns = data.columns.map((_, j) => j).filter((j) => {
      const {features} = data.columns[j];
      return !state.feature.length || state.feature.some((name) => features.includes(name));
    });
    const [by, problem] = state.sort.split(":");
    const number = (value, absent) => (Number.isFinite(value) ? value : absent);
    const column = data.columns.findIndex(({name}) => name === problem);
    const error = (row) => {
      const found = value(row.cells[column], state.show || "position");
      return number(found ? parseFloat(text(found.part)) : NaN, Number.MAX_VALUE);
    };
    if (by === "engine") shown.rows.sort((a, b) => a.apart - b.apart || a.engine.localeCompare(b.engine) || a.place - b.place);
    if (by === "agrees") shown.rows.sort((a, b) => a.apart - b.apart || agreeing(b) - agreeing(a));
    if (by === "problem" && column >= 0) shown.rows.sort((a, b) => a.apart - b.apart || error(a) - error(b));
  }

  // Rows of engines, made when they are first shown. Presets that an engine was not run with stay empty.
  const engineRows = new Map();
  function engineRow(name, apart, ofEngine) {
    const key = `${name} ${apart}`;
    if (!engineRows.has(key)) {
      const head = element("th", {scope: "row", tabIndex: -1}, element("b", {textContent: name}));
      const whole = rows.filter((row) => row.engine === name && row.apart === apart), first = whole[0];
      const facts = whole.map((row) => {
        const known = Object.fromEntries(row.card.facts.map(([name, fact]) => [text(name), text(fact)]));
        return [kept(row.preset), kept(`${known.scheme}; agrees ${known.agrees}`)];
      });
      const card = {...first.card, title: kept(name), facts: [...facts, ...first.card.facts.filter(([name]) => text(name) === "version")]};
      engineRows.set(key, {tr: element("tr"), head, leading: element("td", {className: "leading"}), card, empty: new Map()});
      places.set(head, {row: engineRows.get(key), j: -1});
    }
    const row = engineRows.get(key), of = new Map(ofEngine.map((each) => [each.preset, each]));
    const tds = shown.columns.flatMap((j) => shown.presets.map((preset) => of.get(preset)?.tds[j] ?? emptied(row, preset, j)));
    row.leading.textContent = shown.presets.map((preset) => (of.has(preset) ? agreeing(of.get(preset)) : "–")).join(" ");
    row.tr.replaceChildren(row.head, row.leading, ...tds);
    return row;
  }
  function emptied({empty}, preset, j) {
    const key = `${preset} ${j}`;
    if (!empty.has(key)) {
      const td = element("td", {className: "absent-run", textContent: "·", ariaLabel: "not run"});
      empty.set(key, td);
      places.set(td, {row: {cells: []}, j});
    }
    return empty.get(key);
  }

  // The table's body, and what arrows move along: a line of cells for each row.
  function placed() {
    const made = [];
    shown.lines = [];
    if (!shown.engines) {
      let group = null;
      for (const row of shown.rows) {
        const title = row.apart ? data.apart : row.group;
        if ((!state.sort || row.apart) && title !== group) made.push(headings.get(title));
        group = title;
        row.tr.append(...row.tds);
        made.push(row.tr);
        shown.lines.push([row.head, ...shown.columns.map((j) => row.tds[j])]);
      }
      return made;
    }
    for (const apart of [false, true]) {
      const counted = shown.rows.filter((row) => row.apart === apart);
      const names = [...new Set(counted.map(({engine}) => engine))];
      if (!state.sort || apart) names.sort((a, b) => a.localeCompare(b));
      if (apart && names.length) made.push(headings.get(data.apart));
      for (const name of names) {
        const row = engineRow(name, apart, counted.filter(({engine}) => engine === name));
        made.push(row.tr);
        shown.lines.push([row.head, ...[...row.tr.cells].slice(2)]);
      }
    }
    return made;
  }

  const held = ({holds}, good, bad, open) => (holds === null ? open : holds ? good : bad);
  // The quantity's row of a cell's card.
  const value = (cell, name) => cell?.quantities.find((each) => text(each.quantity) === name);

  function lay() {
    choose();
    const visible = new Set(shown.columns);
    shown.engines = asEngines();
    shown.presets = data.presets.filter((preset) => shown.rows.some((row) => row.preset === preset));
    const parts = shown.engines ? shown.presets.length : 1, leading = shown.engines ? 1 : data.leading;
    table.classList.toggle("engines", shown.engines);
    body.replaceChildren(...placed());
    let before = null;
    heads.forEach((head, j) => {
      const first = visible.has(j) && data.columns[j].group !== before;
      if (visible.has(j)) before = data.columns[j].group;
      head.hidden = !visible.has(j);
      head.colSpan = parts;
      head.classList.toggle("first", first);
      for (const row of rows) {
        row.tds[j].hidden = !visible.has(j);
        row.tds[j].classList.toggle("first", first && (!shown.engines || row.preset === shown.presets[0]));
        row.tds[j].classList.toggle("last", row.preset === shown.presets.at(-1));
      }
    });
    for (const head of groups) {
      const count = shown.columns.filter((j) => data.columns[j].group === head.textContent).length;
      head.hidden = !count;
      head.colSpan = count * parts || 1;
    }
    for (const tr of headings.values()) tr.cells[0].colSpan = shown.columns.length * parts + 1 + leading;
    table.querySelector(".groups td").colSpan = 1 + leading;
    find(".corner span").textContent = shown.engines ? `engine: ${shown.presets.join(", ")}` : "engine, preset";
    table.style.setProperty("--columns", shown.columns.length);
    fill();
    count();
    const [by, problem] = state.sort.split(":");
    heads.forEach((head, j) => head.toggleAttribute("aria-sort", by === "problem" && data.columns[j].name === problem));
    heads.forEach((head) => head.hasAttribute("aria-sort") && head.setAttribute("aria-sort", "ascending"));
    const sort = find("[data-control=sort]"), last = sort.querySelector("[value=problem]");
    last.hidden = by !== "problem";
    last.textContent = problem ? `error on ${problem}` : "error";
    sort.options[0].textContent = shown.engines ? "name" : "scheme";
    sort.querySelector("[value=engine]").hidden = shown.engines;
    sort.value = by;
    const kinds = find("[data-control=rows]");
    kinds.value = shown.engines ? "engines" : "presets";
    kinds.disabled = ofPresets();
    find("[data-control=show]").value = state.show;
    for (const button of section.querySelectorAll("[data-filter]")) {
      const values = state[button.dataset.filter];
      button.querySelector("b").textContent = values.length > 1 ? `${values.length} chosen` : values[0] ?? "all";
      button.toggleAttribute("data-set", values.length > 0);
    }
    for (const box of section.querySelectorAll(".choices input")) box.checked = state[box.name].includes(box.value);
    find("[data-control=reset]").hidden = !Object.entries(state).some(([name, value]) => name !== "cell" && value.length);
    roving();
  }

  // Cells show verdicts, or errors in one quantity in parts of its scale.
  function fill() {
    for (const row of rows) {
      row.tds.forEach((td, j) => {
        const cell = row.cells[j];
        if (!cell) return;
        const found = state.show && value(cell, state.show);
        const holds = found ? held(found, "holds", "breaks", "open") : "";
        td.classList.remove("value", "holds", "breaks", "open", "agrees", "disagrees");
        if (found && text(found.part)) {
          td.classList.add("value", holds);
          td.textContent = short(text(found.part));
        } else {
          const {name, sign: text} = data.states[cell.state];
          if (!state.show || !["agrees", "disagrees"].includes(name)) {
            td.classList.add(name);
            td.replaceChildren(text, ...(cell.symbol ? [element("i", {textContent: cell.symbol})] : []));
          } else {
            td.classList.add("value", "open");
            td.textContent = "";
          }
        }
        td.classList.toggle("chosen", data.states[cell.state].name === state.only);
      });
    }
    table.toggleAttribute("data-only", Boolean(state.only));
    for (const row of rows) {
      const made = shown.columns.filter((j) => row.cells[j]);
      row.tr.cells[data.leading].textContent = `${agreeing(row)}/${made.length}`;
    }
  }
  const short = (number) => number.replace(/^(\d)\.\d+e/, "$1e");

  function count() {
    const total = new Map(), presets = new Map();
    let runs = 0;
    const own = data.shares.map(() => 0);
    for (const row of shown.rows.filter((row) => !row.apart)) {
      for (const j of shown.columns) {
        const cell = row.cells[j];
        if (!cell) continue;
        runs += 1;
        total.set(cell.state, (total.get(cell.state) ?? 0) + 1);
        const of = presets.get(row.preset) ?? presets.set(row.preset, [0, 0]).get(row.preset);
        of[0] += cell.state === 0;
        of[1] += 1;
        if (cell.state === 0 && cell.own >= 0) own[cell.own] += 1;
      }
    }
    const chips = data.states.map(({name, sign, counted}, k) => {
      if (!total.get(k) && state.only !== name) return null;
      const button = element("button", {type: "button", onclick: () => set({only: state.only === name ? "" : name})},
        element("span", {className: `swatch ${name}`, textContent: sign}), element("span", {}, element("b", {textContent: total.get(k) ?? 0}), ` ${counted}`));
      button.setAttribute("aria-pressed", String(state.only === name));
      return button;
    });
    const parts = [...presets].sort((a, b) => data.presets.indexOf(a[0]) - data.presets.indexOf(b[0]))
      .map(([name, [agreeing, made]]) => element("span", {}, `${name}: `, element("b", {textContent: agreeing}), ` of ${made} agree`));
    const shares = data.shares.map((name, k) => own[k] && `${name} ${own[k]}`).filter(Boolean).join(", ");
    counts.replaceChildren(element("span", {className: "of", textContent: `${runs} runs shown:`}), ...chips.filter(Boolean),
      element("span", {className: "by-preset"}, ...parts, ...(shares ? [element("span", {textContent: `the engine's own of what agrees: ${shares}`})] : [])));
  }

  function set(changes) {
    Object.assign(state, changes);
    lay();
    writeAddress();
  }

  // --- Focus moves by arrows, one stop for Tab

  let stop = null;
  const lines = () => {
    const parts = shown.engines ? shown.presets.length : 1;
    return [[null, ...shown.columns.flatMap((j) => Array(parts).fill(heads[j]))], ...shown.lines];
  };
  function roving(target) {
    const all = lines().flat();
    stop = target ?? (stop && all.includes(stop) ? stop : shown.lines[0]?.[1]);
    for (const each of section.querySelectorAll("table[role=grid] [tabindex]")) each.tabIndex = -1;
    if (stop) stop.tabIndex = 0;
  }
  const MOVES = {ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1], Home: [0, -99], End: [0, 99], PageUp: [-10, 0], PageDown: [10, 0]};
  table.addEventListener("keydown", (event) => {
    const target = event.target.closest("[tabindex]");
    if (event.key === "Escape") return close();
    if (!target || event.altKey || event.metaKey) return;
    if (event.key === "Enter" || event.key === " ") {
      event.preventDefault();
      return open(target, true);
    }
    const move = MOVES[event.key];
    if (!move) return;
    event.preventDefault();
    const grid = lines(), i = grid.findIndex((line) => line.includes(target)), j = grid[i].indexOf(target);
    const far = event.ctrlKey ? 99 : 1, clamp = (k, n) => Math.max(0, Math.min(n - 1, k));
    const line = grid[clamp(i + move[0] * far, grid.length)];
    let k = clamp(j + move[1] * far, line.length);
    while (move[1] && line[k] === target && line[k + move[1]]) k += move[1]; // a head has several columns
    const next = line[k];
    if (!next) return;
    roving(next);
    next.focus();
  });

  // --- Cards

  let opened = null, pinned = false, timer = 0;

  const place = (target) => places.get(target) ?? {row: undefined, j: heads.indexOf(target)};

  function cardOf(target) {
    const {row, j} = place(target);
    if (!row) return {...data.columns[j].card, problem: data.columns[j].name};
    if (j < 0) return row.card;
    const cell = row.cells[j];
    return cell && {...cell, on: data.columns[j].name, state: data.states[cell.state], cell: `${row.engine} ${row.preset} ${data.columns[j].name}`};
  }

  function drawn(content) {
    const {state: verdict} = content, parts = [];
    const header = element("header", {}, element("h2", {textContent: text(content.title)}),
      element("button", {type: "button", className: "close", textContent: "✕", ariaLabel: "Close", onclick: () => close(true)}));
    if (verdict) header.prepend(element("span", {className: `swatch ${verdict.name}`, textContent: verdict.sign}));
    parts.push(header);
    if (text(content.lead)) parts.push(element("p", {textContent: text(content.lead)}));
    if (content.quantities?.length) {
      const titles = ["", "quantity", "error", "tolerance", "ratio", ...(content.quantities.some((each) => text(each.count)) ? ["hold"] : [])];
      const head = element("tr", {}, ...titles.map((title) => (title ? element("th", {textContent: title, scope: "col"}) : element("td"))));
      const lines = content.quantities.map((each) => {
        const tr = element("tr", {className: held(each, "holds", "breaks", "open")});
        const unit = text(each.unit) && each.holds !== null ? ` ${text(each.unit)}` : "";
        const name = element("td", {}, text(each.quantity), ...(text(each.subject) ? [element("span", {textContent: ` ${text(each.subject)}`})] : []));
        const source = text(each.source) && ` (${text(each.source)})`;
        const numbers = [text(each.error) + unit, text(each.tolerance) + unit + source, text(each.ratio), text(each.count)].slice(0, titles.length - 2);
        tr.append(element("td", {textContent: held(each, "✓", "✗", "○")}), name, ...numbers.map((cell) => element("td", {className: "number", textContent: cell})));
        return tr;
      });
      parts.push(element("table", {}, element("thead", {}, head), element("tbody", {}, ...lines)));
    }
    parts.push(element("dl", {}, ...content.facts.flatMap(([name, fact]) => [element("dt", {textContent: text(name)}), element("dd", {textContent: text(fact)})])));
    const actions = element("div", {className: "actions"}), foot = element("div", {className: "foot"});
    if (text(content.command)) {
      const command = element("pre", {textContent: text(content.command).replace(data.ofProblem, content.on ?? "")});
      foot.append(command);
      actions.append(element("button", {type: "button", className: "copy", textContent: "copy command", onclick: async ({currentTarget}) => {
        getSelection().selectAllChildren(command);
        try {
          await navigator.clipboard.writeText(command.textContent);
          currentTarget.textContent = "copied";
        } catch { currentTarget.textContent = "selected"; }
      }}));
    }
    if (text(content.link)) actions.append(element("a", {href: text(content.link), textContent: "its page"}));
    if (content.problem) actions.append(element("button", {type: "button", className: "copy", textContent: "sort engines by their error on it", onclick: () => { const {problem} = content; close(); set({sort: `problem:${problem}`}); }}));
    if (actions.children.length) foot.append(actions);
    if (foot.children.length) parts.push(foot);
    card.replaceChildren(...parts);
    card.setAttribute("aria-label", text(content.title));
  }

  function open(target, pin = false) {
    const content = cardOf(target);
    if (!content) return close();
    clearTimeout(timer);
    opened?.classList.remove("opened");
    opened = target;
    pinned = pin;
    target.classList.toggle("opened", pin);
    mark(target);
    drawn(content);
    card.classList.toggle("pinned", pin);
    if (!card.matches(":popover-open")) card.showPopover();
    card.scrollTop = 0;
    beside(target.getBoundingClientRect());
    if (pin) {
      card.querySelector(".close").focus();
      state.cell = content.cell ?? "";
      writeAddress();
    }
  }

  const narrow = matchMedia("(max-width: 600px)");

  function beside(box) {
    if (narrow.matches) { // the card is the lower part of the screen
      card.removeAttribute("style");
      const hidden = box.bottom + 24 - (innerHeight - card.offsetHeight);
      return hidden > 0 && pinned && scrollBy(0, hidden);
    }
    const {offsetWidth: width, offsetHeight: height} = card, gap = 10;
    const right = box.right + gap + width < innerWidth;
    const left = right ? box.right + gap : Math.max(8, box.left - gap - width);
    const top = Math.max(8, Math.min(box.top - 20, innerHeight - height - 8));
    card.style.left = `${left}px`;
    card.style.top = `${top}px`;
  }

  function mark(target) {
    for (const each of section.querySelectorAll(".here")) each.classList.remove("here");
    if (!target) return;
    const {row, j} = place(target);
    if (row) target.parentElement.classList.add("here");
    heads[j]?.classList.add("here");
  }

  function close(back = false) {
    clearTimeout(timer);
    const before = opened;
    opened?.classList.remove("opened");
    opened = null;
    mark(null);
    if (card.matches(":popover-open")) card.hidePopover();
    if (pinned) {
      pinned = false;
      state.cell = "";
      writeAddress();
    }
    quiet = back;
    if (back) before?.focus();
    quiet = false;
  }
  let quiet = false; // focus that comes back opens nothing

  table.addEventListener("focusin", ({target}) => {
    if (!target.matches("[tabindex]")) return;
    roving(target);
    if (!quiet && !pinned && !pointing) open(target);
  });
  // A card that focus opens would lie under the finger before the click.
  let pointing = false;
  table.addEventListener("pointerdown", () => { pointing = true; });
  addEventListener("pointerup", () => setTimeout(() => { pointing = false; }));
  addEventListener("pointercancel", () => { pointing = false; });
  table.addEventListener("focusout", ({relatedTarget}) => {
    if (!pinned && !table.contains(relatedTarget) && !card.contains(relatedTarget)) close();
  });
  table.addEventListener("click", ({target}) => {
    const cell = target.closest("[tabindex]");
    if (cell) open(cell, true);
  });
  // In a narrow window the card would come to lie under the pointer, and a click miss its cell.
  table.addEventListener("pointerover", ({target, pointerType}) => {
    if (pinned || pointerType !== "mouse" || narrow.matches) return;
    clearTimeout(timer);
    const cell = target.closest("[tabindex]");
    timer = cell ? setTimeout(() => open(cell), 90) : setTimeout(close, 250);
  });
  table.addEventListener("pointerleave", ({pointerType}) => {
    if (pinned || pointerType !== "mouse") return;
    clearTimeout(timer);
    timer = setTimeout(close, 250);
  });
  card.addEventListener("pointerenter", () => clearTimeout(timer));
  card.addEventListener("pointerleave", () => { if (!pinned) timer = setTimeout(close, 250); });
  card.addEventListener("keydown", ({key}) => { if (key === "Escape") close(true); });
  document.addEventListener("keydown", ({key}) => { if (key === "Escape" && opened && !pinned) close(); });
  document.addEventListener("pointerdown", ({target}) => { if (pinned && !card.contains(target) && !table.contains(target)) close(); });
  addEventListener("resize", () => opened && beside(opened.getBoundingClientRect()));

  // --- Controls

  for (const control of section.querySelectorAll("select[data-control]")) {
    control.addEventListener("change", () => set({[control.dataset.control]: control.value}));
  }
  find("[data-control=reset]").addEventListener("click", () => {
    set({rows: "", sort: "", show: "", only: "", preset: [], engine: [], scheme: [], feature: []});
    find("[data-control=sort]").focus();
  });
  for (const choices of section.querySelectorAll(".choices")) {
    choices.addEventListener("change", ({target: {name}}) => {
      set({[name]: [...choices.querySelectorAll("input:checked")].map((box) => box.value)});
    });
    choices.addEventListener("toggle", ({newState}) => {
      if (newState !== "open") return;
      const box = choices.previousElementSibling.getBoundingClientRect();
      choices.style.left = `${Math.max(8, Math.min(box.left, innerWidth - choices.offsetWidth - 8))}px`;
      choices.style.top = `${box.bottom + 4}px`;
    });
  }
  small.addEventListener("change", lay);
  addEventListener("hashchange", () => { if (location.hash.includes("=") || !location.hash) start(); });

  function start() {
    readAddress();
    lay();
    const wanted = state.cell && shown.lines.flatMap(([, ...tds]) => tds).find((td) => cardOf(td)?.cell === state.cell);
    if (wanted) {
      wanted.scrollIntoView({block: "center", inline: "center"});
      open(wanted, true);
    }
  }
  find(".controls").hidden = false;
  start();
}
