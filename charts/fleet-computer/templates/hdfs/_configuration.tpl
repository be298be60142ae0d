{{/* core-site.xml and hdfs-site.xml as maps; ${env.NAME} is read by Hadoop in the container. */}}

{{- define "fleet.coreSite" -}}
fs.defaultFS: hdfs://{{ include "fleet.namenodeHost" . }}:8020
hadoop.tmp.dir: /tmp/hadoop
hadoop.security.authentication: simple
# Groups are not asked of the container's passwd, which knows nobody.
hadoop.security.group.mapping: org.apache.hadoop.security.NullGroupsMapping
hadoop.user.group.static.mapping.overrides: hdfs=hdfs;{{ .Values.hdfs.user }}={{ .Values.hdfs.user }};dr.who=
fs.permissions.umask-mode: "027"
{{- end }}

{{- define "fleet.hdfsSite" -}}
dfs.replication: {{ .Values.hdfs.replication | quote }}
# An acknowledged write is on two machines. Without ALWAYS a pipeline of two that loses one goes on with one, and with
# DEFAULT its end is refused; best effort lets it go on when there is no third machine, and close is what is refused.
dfs.namenode.replication.min: {{ .Values.hdfs.minReplication | quote }}
{{- /* On a site of three machines the busy one is needed too: without it there may be no place for a second copy. */}}
dfs.namenode.redundancy.considerLoad: "false"
dfs.client.block.write.replace-datanode-on-failure.enable: "true"
dfs.client.block.write.replace-datanode-on-failure.policy: ALWAYS
dfs.client.block.write.replace-datanode-on-failure.best-effort: "true"
# The end of a write asks until the second copy is reported: at first after 1 ms, not 400 (then 2, 4, 8 ms ...).
dfs.client.block.write.locateFollowingBlock.initial.delay.ms: "1"
dfs.client.block.write.locateFollowingBlock.retries: "13"
# The names are served again when one copy of each block is there. By itself this would follow replication.min, and a
# NameNode that starts while one machine is dark would stay in safe mode.
dfs.namenode.safemode.replication.min: "1"
dfs.namenode.safemode.extension: "10000"
# A silent machine is avoided after 10 s, and called dead after 150 s, which is longer than a reboot: nothing is copied
# for a machine that comes back (dead = 2 x recheck + 10 x heartbeat).
dfs.heartbeat.interval: "3"
dfs.namenode.heartbeat.recheck-interval: "60000"
dfs.namenode.stale.datanode.interval: "10000"
dfs.namenode.avoid.read.stale.datanode: "true"
dfs.namenode.avoid.write.stale.datanode: "true"
dfs.namenode.write.stale.datanode.ratio: "1.0"
dfs.client.socket-timeout: "10000"
dfs.namenode.reconstruction.pending.timeout-sec: "30"
# The address of a machine is the address of its node, whatever a network plug-in makes of the connection.
dfs.namenode.datanode.registration.ip-hostname-check: "false"
dfs.client.use.datanode.hostname: "true"
dfs.datanode.use.datanode.hostname: "true"
dfs.namenode.rpc-address: {{ include "fleet.namenodeHost" . }}:8020
dfs.namenode.http-address: {{ include "fleet.namenodeHost" . }}:9870
dfs.namenode.rpc-bind-host: 0.0.0.0
dfs.namenode.http-bind-host: 0.0.0.0
dfs.namenode.name.dir: file:///hadoop/metadata/name
dfs.namenode.checkpoint.dir: file:///hadoop/metadata/checkpoint
dfs.namenode.checkpoint.period: {{ printf "%ds" (int .Values.hdfs.checkpoint.periodSeconds) | quote }}
dfs.namenode.secondary.http-address: 0.0.0.0:9868
dfs.datanode.data.dir: file:///hadoop/data
dfs.datanode.hostname: ${env.NODE_ADDRESS:-localhost}
dfs.datanode.address: ${env.NODE_ADDRESS:-localhost}:9866
dfs.datanode.http.address: ${env.NODE_ADDRESS:-localhost}:9864
dfs.datanode.ipc.address: ${env.NODE_ADDRESS:-localhost}:9867
dfs.datanode.du.reserved: {{ .Values.hdfs.datanode.reserved | quote }}
{{- end }}

{{/* A map as Hadoop's XML. Numbers of values files are floats to Helm. */}}
{{- define "fleet.siteXml" -}}
<?xml version="1.0"?>
<configuration>
{{- range $name, $value := . }}
  <property><name>{{ $name }}</name><value>{{ if and (kindIs "float64" $value) (eq (floor $value) $value) }}{{ int64 $value }}{{ else }}{{ $value | toString | html }}{{ end }}</value></property>
{{- end }}
</configuration>
{{- end }}

{{/* The files of /etc/hadoop. */}}
{{- define "fleet.hdfsFiles" -}}
core-site.xml: |
  {{- include "fleet.siteXml" (mergeOverwrite (include "fleet.coreSite" . | fromYaml) .Values.hdfs.coreOverrides) | nindent 2 }}
hdfs-site.xml: |
  {{- include "fleet.siteXml" (mergeOverwrite (include "fleet.hdfsSite" . | fromYaml) .Values.hdfs.siteOverrides) | nindent 2 }}
log4j.properties: |
  log4j.rootLogger={{ .Values.hdfs.logLevel }},console
  log4j.appender.console=org.apache.log4j.ConsoleAppender
  log4j.appender.console.target=System.err
  log4j.appender.console.layout=org.apache.log4j.PatternLayout
  log4j.appender.console.layout.ConversionPattern=%d{ISO8601} %p %c{2}: %m%n
  log4j.logger.org.apache.hadoop.util.NativeCodeLoader=ERROR
{{- end }}

{{/* Environment of each process of HDFS. The superuser is whoever the NameNode runs as. */}}
{{- define "fleet.hdfsEnv" -}}
- {name: HADOOP_USER_NAME, value: hdfs}
- {name: HADOOP_CONF_DIR, value: /etc/hadoop}
- {name: HADOOP_OPTS, value: {{ .javaOptions | quote }}}
{{- end }}

{{/* An HTTP request by bash, and whether its answer has a text: what /jmx says is in its body. */}}
{{- define "fleet.jmxProbe" -}}
exec:
  command:
    - bash
    - -c
    - |
      exec 3<>/dev/tcp/{{ .host }}/{{ .port }}
      printf 'GET /jmx?qry={{ .bean }} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n' >&3
      grep -q '{{ .text }}' <&3
periodSeconds: {{ .period }}
timeoutSeconds: 5
{{- end }}
