/** Templates of imports that this device keeps: in the browser, nowhere else. */
import { type Template, templatesIn, withTemplate } from "../lib/template";
import { recalled, remember } from "./kept";

export const keptTemplates = (): Template[] => templatesIn(recalled("templates"));
export const keepTemplate = (template: Template): void =>
  remember("templates", withTemplate(keptTemplates(), template));
