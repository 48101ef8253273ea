// What can be wrong with how a page is laid out: sentences, empty where all is well.
({
  // All folds open, all plots drawn.
  unfold() {
    for (const fold of document.querySelectorAll("details")) fold.open = true;
    dispatchEvent(new Event("beforeprint"));
    dispatchEvent(new Event("afterprint"));
  },
  name(element) {
    const words = (element.textContent || element.getAttribute("aria-label") || "").trim().replace(/\s+/g, " ").slice(0, 40);
    return `<${element.tagName.toLowerCase()}${element.id ? ` id=${element.id}` : ""} class="${element.getAttribute("class") ?? ""}"> “${words}”`;
  },
  hidden(element) {
    return !element.checkVisibility({visibilityProperty: true, opacityProperty: true}) || element.closest("thead, .skip, [hidden]") && element.getBoundingClientRect().right < 0;
  },
  scrolled(element, root = document.body) {
    for (let e = element.parentElement; e && e !== root; e = e.parentElement) {
      if (/auto|scroll|hidden/.test(getComputedStyle(e).overflowX) && e.getBoundingClientRect().right <= innerWidth + 0.5) return e;
    }
    return null;
  },
  // Elements that cross the edges of a page of that width, but for those in boxes that may scroll within themselves.
  leaving(width, scrolling = "pre, .animation-scroll, .verdicts-scroll") {
    const found = [];
    if (document.documentElement.scrollWidth > width) found.push(`the page is ${document.documentElement.scrollWidth} px wide`);
    for (const element of document.body.querySelectorAll("*")) {
      if (this.hidden(element) || element.closest("svg") && element.tagName !== "text" && element.tagName !== "svg") continue;
      const box = element.getBoundingClientRect();
      if (!box.width || (box.left >= -0.5 && box.right <= width + 0.5)) continue;
      const scroller = this.scrolled(element);
      if (scroller && scroller.matches(scrolling) && !element.closest("svg")) continue;
      found.push(`${this.name(element)} from ${box.left.toFixed(1)} to ${box.right.toFixed(1)}`);
    }
    return found;
  },
  // Lines of text of different elements that lie over each other.
  overlapping() {
    const boxes = [], found = [], walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), range = document.createRange();
    for (let node = walker.nextNode(); node; node = walker.nextNode()) {
      const parent = node.parentElement;
      if (!node.data.trim() || parent.closest("script, style, option, pre, [aria-label=tip]") || this.hidden(parent)) continue;
      range.selectNodeContents(node);
      // What is scrolled away in a box with its own scroll bars is not seen.
      const frame = parent.closest(".verdicts-scroll")?.getBoundingClientRect();
      for (const r of range.getClientRects()) {
        if (frame && (r.right < frame.left || r.left > frame.right || r.bottom < frame.top || r.top > frame.bottom)) continue;
        const slack = 0.22 * r.height; // a line's box is higher than its letters
        if (r.width > 1) boxes.push({node: parent, left: r.left + 0.5, right: r.right - 0.5, top: r.top + slack, bottom: r.bottom - slack});
      }
    }
    boxes.sort((a, b) => a.top - b.top);
    boxes.forEach((a, i) => {
      for (let j = i + 1; j < boxes.length && boxes[j].top < a.bottom; j++) {
        const b = boxes[j];
        if (a.node !== b.node && Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1) found.push(`${this.name(a.node)} over ${this.name(b.node)}`);
      }
    });
    return found;
  },
  // Drawings that leave their figure, and figures that are cut between two sheets.
  cut(height) {
    const found = [];
    for (const figure of document.querySelectorAll("figure.plot, section.animation")) {
      const outer = figure.getBoundingClientRect();
      for (const drawing of figure.querySelectorAll(".panel svg, canvas")) {
        if (drawing.closest("[hidden]")) continue; // a plot that was chosen before keeps its drawing
        const box = drawing.getBoundingClientRect();
        if (!box.width || box.left < outer.left - 1 || box.right > outer.right + 1 || box.bottom > outer.bottom + 1) found.push(`a drawing leaves ${this.name(figure)}`);
      }
      for (const axis of ["x", "y"]) {
        const bare = [...figure.querySelectorAll(".panel svg")].some((svg) => !svg.querySelector(`[aria-label="${axis}-axis tick label"]`)?.textContent);
        if (bare) found.push(`${this.name(figure)} has no numbers along ${axis}`);
      }
      const whole = outer.height <= height ? figure : null;
      for (const part of whole ? [whole] : figure.querySelectorAll(".panels > div, canvas")) {
        if (getComputedStyle(part).breakInside !== "avoid") found.push(`${this.name(part)} may be cut`);
        if (part.getBoundingClientRect().height > height) found.push(`${this.name(part)} is higher than a sheet`);
      }
      // Of plots that are chosen among, the chosen ones.
      const bare = [...figure.querySelectorAll(".panel")].some((panel) => !panel.closest("[hidden]") && !panel.querySelector("svg"));
      if (!figure.matches(".animation") && bare) found.push(`a panel of ${this.name(figure)} is empty`);
    }
    return found;
  },
  // Headings that skip a level, anchors that are there twice, links to nowhere.
  structure() {
    const found = [], levels = [...document.querySelectorAll("h1, h2, h3, h4, h5, h6")].filter((h) => h.checkVisibility()).map((h) => [+h.tagName[1], h]);
    if (levels.filter(([level]) => level === 1).length !== 1) found.push("not one h1");
    if (levels[0]?.[0] !== 1) found.push("the first heading is no h1");
    levels.forEach(([level, h], i) => { if (i && level > levels[i - 1][0] + 1) found.push(`${this.name(h)} skips a level`); });
    const ids = [...document.querySelectorAll("[id]")].map((e) => e.id);
    for (const id of new Set(ids.filter((each, i) => ids.indexOf(each) !== i))) found.push(`the anchor ${id} is there twice`);
    for (const link of document.querySelectorAll("a[href]")) {
      const to = link.getAttribute("href");
      if (!to.startsWith("#")) found.push(`a link leaves the page: ${to}`);
      else if (!document.getElementById(decodeURIComponent(to.slice(1)))) found.push(`a link leads nowhere: ${to}`);
    }
    return found;
  },
  // Marks one text of each kind of place and colour: that is enough to judge contrast, which is dear.
  mark_kinds() {
    const seen = new Set(), kinds = new Map();
    const kind = (element) => {
      if (!element) return "";
      if (!kinds.has(element)) {
        const style = getComputedStyle(element);
        const look = [style.color, style.fill, style.backgroundColor, style.backgroundImage, style.opacity, style.fontSize, style.fontWeight];
        kinds.set(element, [kind(element.parentElement), element.tagName, element.getAttribute("class"), ...look].join(";"));
      }
      return kinds.get(element);
    };
    for (const element of document.body.querySelectorAll("*")) {
      if (element.children.length && ![...element.childNodes].some((node) => node.nodeType === Node.TEXT_NODE && node.data.trim())) continue;
      element.toggleAttribute("data-kind", !seen.has(kind(element)));
      seen.add(kind(element));
    }
    return seen.size;
  },
  // From now on, what the focus comes to, and whether that is seen; the number of places it has to come to.
  watch_focus() {
    const stops = "a[href], button:enabled, input:enabled, select:enabled, summary, [tabindex='0']";
    window.reached = new Map();
    window.wanted = [...document.querySelectorAll(stops)].filter((e) => e.checkVisibility({visibilityProperty: true}) && e.getClientRects().length);
    document.addEventListener("focusin", ({target}) => {
      const style = getComputedStyle(target), box = target.getBoundingClientRect();
      const seen = style.outlineStyle !== "none" && parseFloat(style.outlineWidth) >= 2;
      reached.set(target, seen && box.right > 0 && box.bottom > 0 && box.top < innerHeight);
    });
    document.activeElement.blur();
    scrollTo(0, 0);
    return wanted.length;
  },
  unreached() {
    return wanted.filter((e) => !reached.get(e)).map((e) => `${reached.has(e) ? "no outline" : "not reached"}: ${this.name(e)}`);
  },
})
