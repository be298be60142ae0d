{{/* The one place that makes names, labels and addresses. */}}

{{- define "fleet.operator" -}}{{ .Release.Name }}-operator{{- end }}
{{- define "fleet.namenode" -}}{{ .Release.Name }}-namenode{{- end }}
{{- define "fleet.checkpoint" -}}{{ .Release.Name }}-checkpoint{{- end }}
{{- define "fleet.datanode" -}}{{ .Release.Name }}-datanode{{- end }}
{{- define "fleet.hdfs" -}}{{ .Release.Name }}-hdfs{{- end }}
{{- define "fleet.scripts" -}}{{ .Release.Name }}-scripts{{- end }}
{{- define "fleet.test" -}}{{ .Release.Name }}-test{{- end }}

{{- define "fleet.claim" -}}
{{- if eq .Values.storage.kind "volume" -}}
{{- .Values.storage.volume.existingClaim | default (printf "%s-storage" .Release.Name) -}}
{{- end -}}
{{- end }}

{{/* What is in no namespace: two releases of one name in two namespaces need two of them. */}}
{{- define "fleet.clusterRole" -}}{{ .Release.Namespace }}-{{ .Release.Name }}-operator{{- end }}

{{- define "fleet.admission" -}}{{ .Release.Namespace }}-{{ .Release.Name }}-storage{{- end }}

{{- define "fleet.selector" -}}
app.kubernetes.io/name: fleet-computer
app.kubernetes.io/instance: {{ .root.Release.Name }}
app.kubernetes.io/component: {{ .component }}
{{- end }}

{{- define "fleet.labels" -}}
{{ include "fleet.selector" . }}
app.kubernetes.io/part-of: fleet-computer
app.kubernetes.io/version: {{ .root.Chart.AppVersion | quote }}
app.kubernetes.io/managed-by: {{ .root.Release.Service }}
helm.sh/chart: {{ printf "%s-%s" .root.Chart.Name .root.Chart.Version | replace "+" "_" }}
{{- end }}

{{/* Labels of pods: those that choose them, and what NetworkPolicies ask for. The chart's version is not among them: a new
version alone restarts nothing. */}}
{{- define "fleet.podLabels" -}}
{{ include "fleet.selector" . }}
app.kubernetes.io/part-of: fleet-computer
{{- end }}

{{- define "fleet.image" -}}
{{ .root.Values.images.registry }}{{ index .root.Values.images .name }}:{{ .root.Values.images.tag | default .root.Chart.AppVersion }}
{{- end }}

{{- define "fleet.namenodeHost" -}}{{ include "fleet.namenode" . }}.{{ .Release.Namespace }}.svc{{- end }}

{{- define "fleet.storageUri" -}}
{{- if eq .Values.storage.kind "hdfs" -}}
webhdfs://{{ .Values.hdfs.user }}@{{ include "fleet.namenodeHost" . }}:9870{{ .Values.hdfs.root }}?replication={{ .Values.hdfs.replication }}
{{- else if eq .Values.storage.kind "existing" -}}
{{ .Values.storage.existing }}
{{- else -}}
file:///fleet/storage
{{- end -}}
{{- end }}
