import { render } from "preact";
import { App } from "./app";
import { reportStrays } from "./components/basics";
import { text } from "./words";
import { startReadings } from "./features/measure/readings";

document.documentElement.lang = text.language;
const page = document.getElementById("page");
reportStrays();
startReadings();
if (page) render(<App />, page);
