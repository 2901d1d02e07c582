import { render } from "preact";
import { App } from "./app";
import { text } from "./text";

document.documentElement.lang = text.language;
const page = document.getElementById("page");
if (page) render(<App />, page);
