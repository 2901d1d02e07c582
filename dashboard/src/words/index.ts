/** The language of the page. Another one is a file beside en.ts of the same type. */
import { en, type FileFault, type Text } from "./shared";

export const text: Text = en;
export type { FileFault, Text };
