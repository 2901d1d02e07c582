import { render } from "preact";
import { App } from "./app";
import { reportStrays } from "./components/basics";
import { text } from "./i18n";
import { startReadings } from "./state/readings";

document.documentElement.lang = text.language;
const page = document.getElementById("page");
reportStrays();
startReadings();
if (page) render(<App />, page);
