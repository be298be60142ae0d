{{/* What the operator is told; checks.yaml lets operator.extraEnv repeat none of it. */}}
{{- define "fleet.operatorEnv" -}}
- name: FLEET_OPERATOR_NAMESPACE
  valueFrom: {fieldRef: {fieldPath: metadata.namespace}}
- {name: FLEET_OPERATOR_WATCH_NAMESPACES, value: {{ join "," .Values.operator.watchNamespaces | quote }}}
- {name: FLEET_OPERATOR_RUNTIME_IMAGE, value: {{ include "fleet.image" (dict "root" . "name" "runtime") | quote }}}
- {name: FLEET_OPERATOR_PULL_POLICY, value: {{ .Values.images.pullPolicy | quote }}}
- {name: FLEET_OPERATOR_STORAGE_URI, value: {{ include "fleet.storageUri" . | quote }}}
- {name: FLEET_OPERATOR_STORAGE_CLAIM, value: {{ include "fleet.claim" . | quote }}}
- {name: FLEET_OPERATOR_STORAGE_PORTS, value: {{ join "," .Values.storage.ports | quote }}}
- {name: FLEET_OPERATOR_STORAGE_HOSTS, value: {{ join "," .Values.operator.storageHosts | quote }}}
- {name: FLEET_OPERATOR_NETWORK_POLICIES, value: {{ .Values.networkPolicies.enabled | quote }}}
# It has other fleets to see to than those whose storage is away, and asks again soon.
- {name: FLEET_STORAGE_PATIENCE_S, value: "10"}
- {name: FLEET_OPERATOR_WORKERS, value: {{ .Values.operator.workers | quote }}}
- {name: FLEET_OPERATOR_LIBRARY, value: {{ .Values.operator.library | quote }}}
- {name: FLEET_OPERATOR_HEALTH_PORT, value: "8080"}
- {name: FLEET_OPERATOR_LEASE, value: {{ include "fleet.operator" . | quote }}}
- {name: FLEET_OPERATOR_LOG_FORMAT, value: {{ .Values.operator.logFormat | quote }}}
- {name: FLEET_OPERATOR_LOG_LEVEL, value: {{ .Values.operator.logLevel | quote }}}
{{- end }}
