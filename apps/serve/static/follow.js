'use strict';
// Follows the progress of a job; the page is loaded again when it is finished.
(() => {
  const place = document.getElementById('follow');
  if (!place) return;
  const state = document.getElementById('state');
  const bar = document.getElementById('progress');
  const message = document.getElementById('message');
  const events = new EventSource(`/jobs/${place.dataset.job}/events`);
  const queue = document.getElementById('queue');
  // The place in the queue changes by other jobs; the page tells it.
  const waiting = setInterval(async () => {
    try {
      const answer = await fetch(location.href, { headers: { Accept: 'text/html' } });
      const page = new DOMParser().parseFromString(await answer.text(), 'text/html');
      queue.textContent = page.getElementById('queue')?.textContent || '';
    } catch {
      // The stream of events tells whether the service is there.
    }
  }, 5000);
  const show = (event) => {
    const job = JSON.parse(event.data);
    state.textContent = job.status;
    state.className = `state ${job.status}`;
    bar.value = job.progress;
    message.textContent = job.message || '';
    if (job.status !== 'accepted') {
      clearInterval(waiting);
      queue.textContent = '';
    }
    if (['successful', 'failed', 'dismissed'].includes(job.status)) {
      events.close();
      location.reload();
    }
  };
  ['accepted', 'running', 'successful', 'failed', 'dismissed'].forEach((name) => events.addEventListener(name, show));
})();
