/** Files that the page makes itself. */

const STYLED = [
  "fill",
  "fill-opacity",
  "stroke",
  "stroke-width",
  "stroke-dasharray",
  "stroke-opacity",
  "opacity",
  "font-size",
  "font-weight",
  "font-family",
  "text-anchor",
  "dominant-baseline",
  "paint-order",
  "pointer-events",
];

export function save(content: string, type: string, name: string): void {
  const address = URL.createObjectURL(new Blob([content], { type }));
  const anchor = document.createElement("a");
  anchor.href = address;
  anchor.download = name;
  document.body.append(anchor);
  anchor.click();
  anchor.remove();
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
}

/** A drawing of the page as a document of its own: what the style sheet says becomes attributes of each element. */
export function standalone(svg: SVGSVGElement, title: string): string {
  const copy = svg.cloneNode(true) as SVGSVGElement;
  copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
  const [from, to] = [svg.querySelectorAll("*"), copy.querySelectorAll("*")];
  from.forEach((element, i) => settle(element, to[i]));
  copy.removeAttribute("class");
  copy.querySelectorAll("[data-tip]").forEach(spoken);
  const ground = document.createElementNS("http://www.w3.org/2000/svg", "rect");
  ground.setAttribute("width", "100%");
  ground.setAttribute("height", "100%");
  ground.setAttribute("fill", getComputedStyle(svg).getPropertyValue("background-color"));
  const name = document.createElementNS("http://www.w3.org/2000/svg", "title");
  name.textContent = title;
  copy.prepend(name, ground);
  return `<?xml version="1.0" encoding="UTF-8"?>\n${new XMLSerializer().serializeToString(copy)}\n`;
}

/** What the page shows under the pointer becomes a title, which every viewer shows. */
function spoken(mark: Element): void {
  const title = document.createElementNS("http://www.w3.org/2000/svg", "title");
  title.textContent = mark.getAttribute("data-tip");
  mark.prepend(title);
  mark.removeAttribute("data-tip");
  mark.removeAttribute("data-open");
}

function settle(element: Element, copy: Element | undefined): void {
  if (!copy) return;
  const style = getComputedStyle(element);
  for (const property of STYLED) copy.setAttribute(property, style.getPropertyValue(property));
  copy.removeAttribute("class");
}
