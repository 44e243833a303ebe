#!/bin/sh
# Jobs of vlscan-serve on Kubernetes (docs/service.md): an Indexed Job for each, whose pods share the folder of the service.
#
#     kubernetes-engine.sh submit NAME TASKS MEGABYTES COMMAND…
#     kubernetes-engine.sh poll NAME
#     kubernetes-engine.sh cancel NAME
#
# To be set in the environment of the service: VLSCAN_IMAGE, an image with vlscan and vlscan-serve at the paths that the service has them;
# VLSCAN_CLAIM, the claim of a volume that all nodes can write; VLSCAN_DATA, the folder of the service, where the volume is mounted;
# VLSCAN_USER, the number of the user that owns this folder; VLSCAN_CPUS, processors of a pod; KUBECTL, the program.
set -eu
kubectl=${KUBECTL:-kubectl}
verb=$1 name=$2
shift 2

# A word as JSON.
quoted() { printf '"%s"' "$(printf %s "$1" | sed 's/[\\"]/\\&/g')"; }

submit() {
  tasks=$1 megabytes=$2
  shift 2
  command=
  for word in "$@"; do command="$command${command:+, }$(quoted "$word")"; done
  # Pods that fail are started again; what they have completed is kept. The service hands the job in again if that does not suffice.
  "$kubectl" create -f - <<YAML
apiVersion: batch/v1
kind: Job
metadata:
  name: $name
  labels: { app.kubernetes.io/name: vlscan }
spec:
  completionMode: Indexed
  completions: $tasks
  parallelism: $tasks
  backoffLimitPerIndex: 3
  ttlSecondsAfterFinished: 3600
  template:
    metadata:
      labels: { app.kubernetes.io/name: vlscan }
    spec:
      restartPolicy: Never
      automountServiceAccountToken: false
      enableServiceLinks: false
      securityContext:
        runAsNonRoot: true
        runAsUser: ${VLSCAN_USER:-1000}
        seccompProfile: { type: RuntimeDefault }
      containers:
        - name: vlscan
          image: ${VLSCAN_IMAGE:?the image with vlscan and vlscan-serve}
          command: [$command]
          securityContext:
            allowPrivilegeEscalation: false
            readOnlyRootFilesystem: true
            capabilities: { drop: [ALL] }
          resources:
            requests: { cpu: "${VLSCAN_CPUS:-4}", memory: ${megabytes}M }
            limits: { cpu: "${VLSCAN_CPUS:-4}", memory: ${megabytes}M }
          volumeMounts:
            - { name: data, mountPath: "${VLSCAN_DATA:?the folder of the service}" }
      volumes:
        - name: data
          persistentVolumeClaim: { claimName: ${VLSCAN_CLAIM:?the claim of the volume} }
YAML
}

case $verb in
  submit) submit "$@" ;;
  poll)
    state=$("$kubectl" get job "$name" --ignore-not-found \
      -o 'jsonpath={.metadata.name}{range .status.conditions[?(@.status=="True")]}{" "}{.type}{end}{" "}')
    case $state in
      *" Complete "* | *" Failed "*) ;;
      *) printf %s "$state" ;;
    esac
    ;;
  # The Job is gone when its pods are.
  cancel) "$kubectl" delete job "$name" --ignore-not-found --cascade=foreground --wait=false ;;
  *)
    echo "$verb: expected submit, poll or cancel" >&2
    exit 2
    ;;
esac
