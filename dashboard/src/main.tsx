import { render } from "preact";
import { App } from "./app";
import { reportStrays } from "./components/basics";
import { text } from "./i18n";

document.documentElement.lang = text.language;
const page = document.getElementById("page");
reportStrays();
if (page) render(<App />, page);
