/** Templates of imports that this device keeps: in the browser, nowhere else. */
import { type Template, templatesIn, withTemplate } from "../lib/template";

const KEY = "jointstiff.templates";

export function keptTemplates(): Template[] {
  try {
    return templatesIn(localStorage.getItem(KEY));
  } catch {
    return []; // storage may be switched off
  }
}

export function keepTemplate(template: Template): void {
  try {
    localStorage.setItem(KEY, JSON.stringify(withTemplate(keptTemplates(), template)));
  } catch {
    // then it is not offered again
  }
}
