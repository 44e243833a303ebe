'use strict';
// Follows the progress of a job; the page is loaded again when it is finished.
(() => {
  const place = document.getElementById('follow');
  if (!place) return;
  const state = document.getElementById('state');
  const bar = document.getElementById('progress');
  const message = document.getElementById('message');
  const events = new EventSource(`/jobs/${place.dataset.job}/events`);
  const show = (event) => {
    const job = JSON.parse(event.data);
    state.textContent = job.status;
    state.className = `state ${job.status}`;
    bar.value = job.progress;
    message.textContent = job.message || '';
    if (['successful', 'failed', 'dismissed'].includes(job.status)) {
      events.close();
      location.reload();
    }
  };
  ['accepted', 'running', 'successful', 'failed', 'dismissed'].forEach((name) => events.addEventListener(name, show));
})();
