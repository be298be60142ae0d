{{/* Where NameNode and checkpoint keep names: a folder of the node, or a claim of the StatefulSet. */}}

{{- define "fleet.metadataMounts" -}}
- {name: metadata, mountPath: /hadoop/metadata}
- {name: configuration, mountPath: /etc/hadoop, readOnly: true}
- {name: tmp, mountPath: /tmp}
{{- end }}

{{- define "fleet.metadataVolumes" -}}
- name: configuration
  configMap: {name: {{ include "fleet.hdfs" .root }}}
- {name: tmp, emptyDir: {}}
{{- with .values.hostPath }}
- name: metadata
  hostPath: {path: {{ . }}, type: DirectoryOrCreate}
{{- end }}
{{- end }}

{{- define "fleet.metadataClaim" -}}
{{- if not .values.hostPath -}}
# The claim stays when the release is uninstalled: it is all that knows which block belongs to which file.
persistentVolumeClaimRetentionPolicy: {whenDeleted: Retain, whenScaled: Retain}
volumeClaimTemplates:
  - metadata:
      name: metadata
      labels: {{- include "fleet.selector" .labels | nindent 8 }}
    spec:
      accessModes: [ReadWriteOnce]
      {{- with .values.persistentVolumeClaim.storageClassName }}
      storageClassName: {{ . }}
      {{- end }}
      resources:
        requests:
          storage: {{ .values.persistentVolumeClaim.size }}
{{- end }}
{{- end }}
