/* What eyes see of the view as it stands: most functions return faults in words. */
(() => {
  const NUMBER = /\d[.,]\d|\d\s*·\s*10/; // a fraction is a quantity; whole numbers may count things
  const FIGURES = /^[-−+\d.,;\s]*\d[-−+\d.,;\se]*$/; // a number or several
  const NOTATION = /3\.188\(17\): .*|\bp [<=] [\d.]+/; // says how uncertainties are written
  const UNIT =
    /%|°|‰|\b(?:mm|µm|μm|m|km|rad|mrad|µrad|deg|N|kN|kg|g|s|ms|min|h|Hz|MB|kB|m²|s²)\b|N·m|Nm|\/rad|\/m\b|\/N\b/;
  const ALONE = /\b(?:scale|ratio|times|weight|p value|correlation|singular values|condition number|degrees of freedom)\b|×|χ²|O[₁-₅]|R$|versions|direction|points along|\bcondition\b|std\. uncertaint|parameters|penalty|\bsigma\b|K_c\/k|combination of|\bdetermine\b/i; // pure numbers
  const BARS = ".header, .sections, .gobar, .selection, .toasts, .tip, .skip, .head .folded[open]"; // layers above the view
  const BLOCK = "td, th, dd, dt, li, p, label, figcaption, h1, h2, h3, legend, summary, option, button, output, [role=cell], [role=columnheader], .gain, .figures > span, svg";

  let known = new Map();
  let read = new Map();

  /** Boxes around an element that cut off what goes beyond them, and how; null if it is not shown at all. */
  function edges(element) {
    if (!element || element === document.body) return [];
    if (!known.has(element)) {
      const style = getComputedStyle(element);
      const further = style.position === "fixed" ? [] : edges(element.parentElement);
      const gone = style.clipPath !== "none" || style.visibility === "hidden" || style.opacity === "0" || !further;
      const cuts = style.overflowX !== "visible" && element.clientWidth > 0;
      const scrolls = ["auto", "scroll"].includes(style.overflowX);
      const ellipsis = style.textOverflow === "ellipsis" || style.webkitLineClamp !== "none";
      const edge = { box: element.getBoundingClientRect(), scrolls, ellipsis };
      known.set(element, gone ? null : cuts ? [...further, edge] : further);
    }
    return known.get(element);
  }

  const shown = (element) => element.checkVisibility() && edges(element) !== null;

  /** The part of a box that no box around it cuts off; null if nothing is left. What scrolls cuts off nothing for `ever`. */
  function seen({ left, top, right, bottom }, element, ever = false) {
    for (const { box, scrolls } of edges(element) ?? []) {
      if (scrolls && ever) continue;
      [left, right] = [Math.max(left, box.left), Math.min(right, box.right)];
      [top, bottom] = [Math.max(top, box.top), Math.min(bottom, box.bottom)];
    }
    return right - left > 1 && bottom - top > 1 ? { left, top, right, bottom } : null;
  }

  /** Pieces of text, line by line, with the height of their letters. */
  function* texts(root = document.body, ever = false) {
    const walker = document.createTreeWalker(root, NodeFilter.SHOW_TEXT);
    while (walker.nextNode()) {
      const node = walker.currentNode;
      const element = node.parentElement;
      if (!node.textContent.trim() || !element.checkVisibility || !shown(element)) continue;
      if (element.closest("option, .scene-labels, noscript, script, style, title")) continue;
      const range = document.createRange();
      range.selectNodeContents(node);
      const size = parseFloat(getComputedStyle(element).fontSize);
      for (const line of range.getClientRects()) {
        const middle = (line.top + line.bottom) / 2;
        const turned = line.height > 1.7 * size;
        const letters = turned
          ? line
          : { left: line.left, right: line.right, top: middle - 0.36 * size, bottom: middle + 0.36 * size };
        const box = seen(letters, element, ever);
        if (box) yield { node, element, box, line: letters, bar: element.closest(BARS), drawn: element.closest("svg") };
      }
    }
  }

  const words = (element) => element.textContent.trim().replace(/\s+/g, " ").slice(0, 60);

  function overlaps() {
    const faults = new Set();
    const boxes = [...texts()].map((one) => ({ ...one, said: words(one.node) }));
    for (const control of document.querySelectorAll("input, select, textarea, button, a.button")) {
      if (!shown(control) || control.matches("[type=range]")) continue;
      const box = seen(control.getBoundingClientRect(), control.parentElement);
      if (box) boxes.push({ node: control, element: control, box, bar: control.closest(BARS), said: control.outerHTML.slice(0, 90) });
    }
    boxes.sort((a, b) => a.box.left - b.box.left);
    for (const [i, one] of boxes.entries()) {
      for (let j = i + 1; j < boxes.length && boxes[j].box.left < one.box.right - 1.5; j++) {
        const other = boxes[j];
        if (one.node === other.node || one.bar !== other.bar) continue;
        if (one.element.contains(other.element) && one.node === one.element) continue;
        if (other.element.contains(one.element) && other.node === other.element) continue;
        const high = Math.min(one.box.bottom, other.box.bottom) - Math.max(one.box.top, other.box.top);
        if (high > 1.5) faults.add(`"${one.said}" and "${other.said}" overlap`);
      }
    }
    return [...faults];
  }

  /** Heads of a cell that are seen: of its column, of its row, of its table. */
  function heads(cell) {
    const table = cell.closest("table, [role=table]");
    if (!table) return [];
    const row = cell.closest("tr, [role=row]");
    const cells = [...row.children];
    const head = table.querySelector("thead tr:last-of-type, .joint-head, [role=row]:has([role=columnheader])");
    const found = [...row.querySelectorAll("th, [role=rowheader]"), ...table.querySelectorAll("caption")];
    if (head && head !== row) found.push(head.children[cells.indexOf(cell)]);
    const group = table.querySelector("thead tr:first-of-type");
    if (group && group !== head) found.push(...group.children);
    const card = table.closest("section, figure, .card");
    return [...found, ...(card?.querySelectorAll(":scope > :is(h2, h3, p, figcaption)") ?? [])];
  }

  function near(element) {
    const block = element.closest(BLOCK) ?? element;
    const cell = element.closest("td, th, [role=cell]");
    const found = [block, ...(cell ? [cell, ...heads(cell)] : [])];
    if (block.matches("dd")) found.push(block.previousElementSibling);
    if (block.matches("svg")) found.push(block.closest("figure, section, .card, [role=row]")?.querySelector("figcaption, h2, h3"));
    if (block.closest("[role=table]") && block.matches("svg")) found.push(...heads(block.closest("[role=cell], [role=columnheader]") ?? block));
    return found.filter(Boolean);
  }

  /** Words of an element that can be seen. */
  function said(element) {
    if (!read.has(element)) read.set(element, [...texts(element, true)].map(({ node }) => node.textContent).join(" "));
    return read.get(element);
  }

  function bareNumbers() {
    const faults = new Set();
    for (const { node, element, bar } of texts(document.querySelector("main"))) {
      if (bar || !NUMBER.test(node.textContent.replace(NOTATION, "")) || element.closest("bdi, code, pre, time, a.file, h1")) continue;
      const around = near(element).map(said).join(" ");
      const own = element.closest(BLOCK);
      if (UNIT.test(around) || ALONE.test(around)) continue;
      faults.add(`no unit beside "${words(node)}" in "${words(own ?? element)}" (${around.slice(0, 80)})`);
    }
    for (const input of document.querySelectorAll("main input")) {
      if (!shown(input) || !NUMBER.test(input.value) || !/number|text/.test(input.type)) continue;
      const label = [...(input.labels ?? []), input.closest("td, .field, label, .row"), input.closest("fieldset")?.querySelector("legend")].filter(Boolean).map(said);
      const around = [...label, ...near(input).map(said), input.getAttribute("aria-label") ?? ""].join(" ");
      if (!UNIT.test(around) && !ALONE.test(around)) faults.add(`no unit beside the field ${input.outerHTML.slice(0, 90)}`);
    }
    return [...faults];
  }

  function clippedHeads(paper) {
    const faults = new Set();
    for (const head of document.querySelectorAll("thead th, [role=columnheader]")) {
      if (!shown(head) || !head.textContent.trim()) continue;
      const box = head.getBoundingClientRect();
      let cut = head.scrollWidth > head.clientWidth + 1 && head.clientWidth > 0 && getComputedStyle(head).display !== "inline";
      for (let around = head.parentElement; around && !cut; around = around.parentElement) {
        const flow = getComputedStyle(around).overflowX;
        if (!paper && (flow === "auto" || flow === "scroll")) break;
        const edge = around.getBoundingClientRect();
        if (flow !== "visible") cut = box.left < edge.left - 1 || box.right > edge.right + 1;
      }
      if (paper) cut ||= box.right > innerWidth + 1;
      if (cut) faults.add(`the head "${words(head)}" is cut off`);
    }
    return [...faults];
  }

  function highRows(most) {
    const faults = new Set();
    for (const row of document.querySelectorAll("main .item, main tbody tr, main .joint[role=row]")) {
      if (!shown(row) || row.querySelector("input:not([type=checkbox]), select, textarea")) continue;
      const { height } = row.getBoundingClientRect();
      if (height > most + 0.5) faults.add(`a row of ${Math.round(height)} px: "${words(row)}"`);
    }
    return [...faults];
  }

  /** Text that a box cuts off without an ellipsis, and choices whose words are wider than their box. */
  function cutTexts() {
    const faults = new Set();
    for (const { node, element, line, drawn } of texts(document.body, true)) {
      let { left, right, top, bottom } = line;
      for (const { box, scrolls, ellipsis } of [...(edges(element) ?? [])].reverse()) {
        if (scrolls) break;
        const beyond = left < box.left - 1.5 || right > box.right + 1.5 || top < box.top - 1.5 || bottom > box.bottom + 1.5;
        if (beyond && !ellipsis) faults.add(`"${words(node)}" is cut off by its box`);
        [left, right] = [Math.max(left, box.left), Math.min(right, box.right)];
        [top, bottom] = [Math.max(top, box.top), Math.min(bottom, box.bottom)];
        if (right < left || bottom < top) break;
      }
      const chart = drawn && getComputedStyle(drawn).overflow !== "visible" ? drawn.getBoundingClientRect() : null;
      if (chart && (line.left < chart.left - 1.5 || line.right > chart.right + 1.5)) faults.add(`"${words(node)}" is cut off by its drawing`);
    }
    return [...faults];
  }

  /** Numbers that are wider than their field. */
  function cutFields() {
    const faults = new Set();
    for (const field of document.querySelectorAll("main :is(input, textarea)")) {
      const isCut = field.scrollWidth > field.clientWidth + 1 || (field.rows && field.scrollHeight > field.clientHeight + 1);
      if (!isCut || !shown(field) || !FIGURES.test(field.value)) continue;
      const label = field.getAttribute("aria-label") ?? [...(field.labels ?? [])].map(words).join();
      faults.add(`"${field.value}" is cut off by its field "${label}"`);
    }
    return [...faults];
  }

  /** Sentences that share their width with a button whose words take several lines. */
  function squeezedSentences() {
    const faults = new Set();
    const blocks = "li, .note, .toast, .selection, .card, section, form";
    const sentences = [...texts()].filter(
      ({ node, element }) => node.textContent.trim().split(/\s+/).length > 3 && !element.closest("button, a, summary, label, table"),
    );
    for (const button of document.querySelectorAll("button.button, a.button")) {
      if (!shown(button) || linesOf(button) < 2) continue;
      const box = button.getBoundingClientRect();
      for (const { node, element, box: other } of sentences) {
        const beside = Math.min(box.bottom, other.bottom) - Math.max(box.top, other.top) > 2;
        if (beside && element.closest(blocks) === button.closest(blocks))
          faults.add(`"${words(node)}" shares its width with the button "${words(button)}"`);
      }
    }
    return [...faults];
  }

  /** In how many lines the words of an element are. */
  function linesOf(element) {
    const range = document.createRange();
    range.selectNodeContents(element);
    const tops = [...range.getClientRects()].map(({ top }) => Math.round(top));
    return new Set(tops).size;
  }

  /** More words of ours than a person reads before the first scroll: names are those of others. */
  function wordsAbove(most) {
    let count = 0;
    for (const { node, element, box, bar } of texts(document.querySelector("main"))) {
      if (bar || element.closest("bdi") || box.top + scrollY > innerHeight) continue;
      const range = document.createRange();
      range.selectNodeContents(node);
      count += (node.textContent.match(/\p{L}{2,}/gu) ?? []).length / range.getClientRects().length;
    }
    return count <= most ? [] : [`${Math.round(count)} words above the fold`];
  }

  /** Stiffnesses and intervals of tables that another way than the component of estimates has printed. */
  function secondWays() {
    const UNIT = /N[·.]m\/(?:rad|arcmin)|kN[·.]m\/(?:°|deg)|rad\/\(k?N[·.]m\)|N\/[µu]m|µm\/k?N/;
    const NO_STIFFNESS = /^(?:p|freedom|prior\/data|negative|rigid|undetermined)$/;
    const A_SENTENCE = 60; // characters
    const faults = new Set();
    for (const cell of document.querySelectorAll("main :is(td, [role=cell])")) {
      const shown = words(cell);
      if (cell.textContent.length > A_SENTENCE) continue;
      if (!/\d/.test(shown) || !cell.checkVisibility() || cell.querySelector(".estimate, .interval-of, input")) continue;
      const table = cell.closest("table, [role=table]");
      const heads = table.querySelectorAll("thead th, [role=columnheader]");
      const head = heads.length > 0 ? words(heads[[...cell.parentElement.children].indexOf(cell)] ?? cell) : "";
      const about = [...(table.closest("section, figure")?.querySelectorAll(":scope > :is(h2, p.soft)") ?? [])];
      const isNumber = cell.classList.contains("number") && !/%/.test(shown) && !NO_STIFFNESS.test(head);
      const inUnit = UNIT.test(head) || UNIT.test(shown) || (isNumber && about.some((each) => UNIT.test(words(each))));
      if (inUnit || /\d\s…\s/.test(shown)) faults.add(`"${shown}" below "${head}" is no estimate`);
    }
    return [...faults];
  }

  /** Numbers in bold that must not be used. */
  function boldUnusable() {
    const faults = new Set();
    for (const { node, element } of texts(document.querySelector("main"))) {
      if (!element.closest(".unusable [role=cell], .estimate.unusable") || !/\d/.test(node.textContent)) continue;
      if (Number(getComputedStyle(element).fontWeight) >= 600) faults.add(`"${words(node)}" is bold and must not be used`);
    }
    return [...faults];
  }

  /** A view that nobody scrolls to its end. */
  function tooHigh(most) {
    const height = document.documentElement.scrollHeight;
    return height <= most ? [] : [`the view is ${height} px high`];
  }

  /** Headings that skip a level, or come before that of the view. */
  function headings() {
    const faults = [];
    let before = 0;
    for (const heading of document.querySelectorAll("main :is(h1, h2, h3, h4, h5, h6)")) {
      if (!heading.checkVisibility()) continue;
      const level = Number(heading.tagName[1]);
      if (level > before + 1) faults.push(`a heading of level ${level} after one of level ${before}: "${words(heading)}"`);
      before = level;
    }
    return faults;
  }

  /** The first row of the joints stands low. */
  function firstStiffness(most) {
    const value = document.querySelector("main .joint > .value");
    if (!value) return ["no stiffness"];
    const bottom = value.getBoundingClientRect().bottom + scrollY;
    return bottom <= most ? [] : [`the first stiffness stands at ${Math.round(bottom)} px`];
  }

  function firstNumber(most) {
    let first = Infinity;
    let total = 0;
    for (const { node, element, box, bar } of texts(document.querySelector("main"))) {
      if (bar || !/\d/.test(node.textContent) || element.closest("h1, bdi, code, time, button, label, .tabs, .actions")) continue;
      total += 1;
      first = Math.min(first, box.bottom + scrollY);
    }
    if (total === 0) return [];
    return first <= most ? [] : [`the first number stands at ${Math.round(first)} px`];
  }

  /**
   * Faults of the view as it comes: too many words above the fold, the view too high [px], the first number and the
   * first stiffness too low [px]; 0 for no limit.
   */
  window.first = (mostWords, mostHeight, mostFirst, mostStiffness) => {
    [known, read] = [new Map(), new Map()];
    return [
      ...wordsAbove(mostWords),
      ...tooHigh(mostHeight),
      ...(mostFirst ? firstNumber(mostFirst) : []),
      ...(mostStiffness ? firstStiffness(mostStiffness) : []),
    ];
  };

  /** All other faults at a width, on a screen or on paper, with what is folded opened. */
  window.seeing = (paper, mostRow) => {
    [known, read] = [new Map(), new Map()];
    return [
      ...overlaps(),
      ...bareNumbers(),
      ...clippedHeads(paper),
      ...cutTexts(),
      ...cutFields(),
      ...squeezedSentences(),
      ...headings(),
      ...boldUnusable(),
      ...secondWays(),
      ...(mostRow ? highRows(mostRow) : []),
    ];
  };
})();

/* Type a long number into all blank boxes for numbers. */
window.typed = async () => {
  for (const box of document.querySelectorAll("main input[inputmode=decimal]")) {
    if (box.value) continue;
    box.value = "-1726.4830";
    box.dispatchEvent(new Event("input", { bubbles: true }));
    await new Promise((done) => requestAnimationFrame(done));
  }
};

/* Wait until charts have the width of their place for some frames. */
window.drawn = async () => {
  const drawings = () => [...document.querySelectorAll("svg[width]")];
  const widths = () => drawings().map((svg) => svg.getAttribute("width")).join();
  for (let [before, same] = ["", 0]; same < 3; ) {
    await new Promise((done) => requestAnimationFrame(done));
    same = widths() === before ? same + 1 : 0;
    before = widths();
  }
};

/* Return what is too wide, cut off, beyond the screen, or too small to tap. */
window.ill = () => {
  const faults = [];
  const wide = document.documentElement.scrollWidth;
  if (wide > innerWidth) faults.push(`the view is ${wide} px wide`);
  const title = document.querySelector("h1");
  const room = title.getBoundingClientRect();
  const lines = room.height / parseFloat(getComputedStyle(title).lineHeight);
  if (lines > 3.1) faults.push(`the title has ${lines.toFixed(1)} lines`);
  if (room.width < Math.min(300, innerWidth - 60)) faults.push(`the title is ${room.width} px wide`);
  const scrolls = (element) => {
    for (let box = element.parentElement; box; box = box.parentElement) {
      if (["auto", "scroll"].includes(getComputedStyle(box).overflowX) && box !== document.body) return true;
    }
    return false;
  };
  const inLabel = "label.option, label.toggle, label.pick";
  const all = `a, button, select, summary, textarea, input, ${inLabel}`;
  for (const control of document.querySelectorAll(all)) {
    if (!control.checkVisibility() || control.closest(".skip, .hidden")) continue;
    if (control instanceof HTMLInputElement && control.closest(inLabel)) continue;
    const {width, height, left, right} = control.getBoundingClientRect();
    const name = control.outerHTML.slice(0, 120);
    if (width < 39.5 || height < 39.5) faults.push(`${width} x ${height} px to tap: ${name}`);
    const beyond = left < -0.5 || right > innerWidth + 0.5;
    if (beyond && !scrolls(control)) faults.push(`beyond the screen: ${name}`);
    const {scrollWidth, clientWidth, scrollHeight, clientHeight} = control;
    const cut = scrollWidth > clientWidth + 1 || scrollHeight > clientHeight + 1;
    const holds = ".button, .tabs a, .sections a, summary, label.option, label.toggle";
    if (cut && control.matches(holds)) faults.push(`cut off: ${name}`);
  }
  for (const words of document.querySelectorAll("p, dd, h2, h3, td, .legend li, .angles span")) {
    const apart = words.closest(".scroll, .hidden, .scene-labels");
    if (apart || !words.checkVisibility() || words.getBoundingClientRect().right <= innerWidth + 1) continue;
    faults.push(`words beyond the screen: ${words.outerHTML.slice(0, 120)}`);
  }
  return faults;
};

/* Return the pairs of size and weight of all words. */
window.pairs = () => {
  const pairs = new Set();
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement;
    if (!walker.currentNode.textContent.trim() || !element.checkVisibility()) continue;
    const {fontSize, fontWeight} = getComputedStyle(element);
    pairs.add(`${fontSize} ${fontWeight}`);
  }
  return [...pairs].sort();
};

/* Return what axe-core finds that is serious. */
window.check = async (rules) => {
  const found = await axe.run(document, {resultTypes: ["violations"], ...rules});
  return found.violations.filter((v) => ["serious", "critical"].includes(v.impact)).map((v) =>
    v.id + ": " + v.nodes.slice(0, 3).map((n) => n.html + " " + n.failureSummary).join("\n"));
};

/* Return targets that are less than 44 px. */
window.small = (least) => [...document.querySelectorAll("a, button, select, summary, input:not(.hidden)")]
  .filter((e) => e.offsetParent !== null && !e.closest(".skip, label.option, label.toggle"))
  .filter((e) => !(e instanceof HTMLInputElement && ["checkbox", "radio"].includes(e.type)))
  .map((e) => [e, e.getBoundingClientRect()])
  .filter(([e, box]) => box.height < least - 0.5 || box.width < least - 0.5)
  .map(([e, box]) => `${e.outerHTML.slice(0, 120)} ${box.width} x ${box.height}`);
