// Draw each figure over its static picture when it comes near the screen, and start plotly with the first, so that a long
// report opens at once; a figure that fails keeps the picture.
"use strict";
(() => {
  // Pictures far from the screen wait until the page has opened; afterwards all of them load, since paper shows them, too.
  addEventListener("load", () => { for (const picture of document.querySelectorAll("img[loading]")) picture.loading = "eager"; });
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const config = {
    displayModeBar: false, // drag to zoom, double click to go back
    responsive: true,
  };
  const start = () => {
    const script = document.createElement("script"); // its text has a hash in the page's policy
    script.textContent = document.getElementById("plotly").textContent;
    document.head.append(script);
  };
  const draw = (place) => {
    if (!window.Plotly) start();
    const figure = figures[Number(place.dataset.figure)];
    place.classList.add("drawn");
    Plotly.newPlot(place.querySelector(".live"), figure.data, figure.layout, config).catch(() => place.classList.remove("drawn"));
  };
  const watcher = new IntersectionObserver((entries) => {
    for (const { isIntersecting, target } of entries) {
      if (!isIntersecting) continue;
      watcher.unobserve(target);
      draw(target);
    }
  }, { rootMargin: "600px" });
  for (const place of document.querySelectorAll("[data-figure]")) watcher.observe(place);
})();
