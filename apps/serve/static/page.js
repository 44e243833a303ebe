'use strict';
// All pages: times in the zone of the browser, and what stands in for pictures that cannot be drawn.
(() => {
  const zone = new Intl.DateTimeFormat(undefined, { dateStyle: 'medium', timeStyle: 'short' });
  document.querySelectorAll('time[datetime]').forEach((time) => {
    const moment = new Date(time.dateTime);
    if (Number.isNaN(moment.getTime())) return;
    time.title = time.textContent;
    time.textContent = zone.format(moment);
  });

  document.querySelectorAll('.drawn').forEach((figure) => {
    const [picture, said] = [figure.querySelector('img'), figure.querySelector('.waiting')];
    if (!picture || !said) return;
    const done = () => { said.hidden = true; };
    const failed = () => {
      picture.hidden = true;
      said.textContent = 'There is no picture.';
    };
    picture.addEventListener('load', done);
    picture.addEventListener('error', failed);
    if (picture.complete) (picture.naturalWidth > 0 ? done : failed)();
  });
})();
